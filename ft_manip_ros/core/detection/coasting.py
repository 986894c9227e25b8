"""Compiled: a joint that stops dead, for arms whose commands nobody tells.

Without a command a rest is no evidence, but the way into it is: no healthy joint stops faster than
its drive can brake. The way on which its speed would have carried it at two and a half times the
hardest braking ever seen is motion that it failed to show.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.detection.layout import PAST
from ft_manip_ros.core.detection.tracking import noise_of

Array = NDArray[np.float64]

_SPAN: Final = 0.03  # s over which a speed is measured
_LEAST_SAMPLES: Final = 3
_SETTLED: Final = 0.06  # s of stillness before a stop is looked at
_COARSEST: Final = 0.1  # s: sampled more slowly, a stop cannot be told from braking
_HARDER: Final = 2.5  # times the hardest braking seen
_ENOUGH: Final = 200  # moving samples
_ENOUGH_STOPS: Final = 2
_STOPPED: Final = 0.3  # s
_MEMORY: Final = 300.0  # s of motion


@kernel
def observe_coasting(r: Any, past_t: Array, past_q: Array, t: float, q: float) -> None:
    """Take one accepted sample of a joint without command, after its stillness was judged."""
    if r.past_n > 0 and t - past_t[(r.past_n - 1) % PAST] > 1.0:
        r.past_n = 0
    past_t[r.past_n % PAST] = t
    past_q[r.past_n % PAST] = q
    r.past_n += 1
    span = max(_LEAST_SAMPLES, int(np.ceil(_SPAN / r.period))) if r.period > 0.0 else PAST
    if 2 * span >= min(r.past_n, PAST) or span * r.period > _COARSEST:
        r.stop_speed = 0.0
        r.missing = 0.0
        return
    i, j = (r.past_n - 1 - span) % PAST, (r.past_n - 1 - 2 * span) % PAST
    late = (q - past_q[i]) / (t - past_t[i])
    if r.still_n == 1:
        # It moved since the last sample: its speed and its braking are those of a live joint.
        early = (past_q[i] - past_q[j]) / (past_t[i] - past_t[j])
        noise = 4.0 * noise_of(r) / (t - past_t[i])
        change = max(abs(late - early) - noise, 0.0) / (t - past_t[i])
        fading = 1.0 - min(t - r.t_1, 1.0) / _MEMORY
        r.braking = max(change, r.braking * fading)
        r.moving_n += 1
        r.stop_speed = max(abs(late) - noise, 0.0)
        r.stop_counted = False
    elif not r.stop_counted and r.still_time > _STOPPED:
        r.stop_counted = True
        r.stops += 1
    if r.still_n < _LEAST_SAMPLES or r.still_time < _SETTLED:
        r.missing = 0.0
        return
    if r.moving_n < _ENOUGH or r.stops < _ENOUGH_STOPS or r.braking <= 0.0:
        return
    r.missing = r.stop_speed * r.stop_speed / (2.0 * _HARDER * r.braking)
