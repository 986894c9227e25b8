"""Compiled: how far the command has moved on while the joint stood still.

The window begins at the last sample at which the joint moved. While it lasts, the command is
looked at only where even the slowest believable tracking must have brought it to the joint: from
``still_since - lag_low`` to ``t - lag_high``. Its range there, ``missing``, is motion that a
healthy joint must have shown. Steady offsets drop out, since only motion is compared.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.detection.tracking import command_at, noise_of, slack_of

Array = NDArray[np.float64]

_ANCHOR_SAMPLES = 4  # averaged to say where the joint stands
_BEGUN = 0.1  # share of the threshold at which the evidence begins
_HIGH_EFFORT_SHARE = 0.7  # of the threshold is enough when the effort speaks too


@numba.njit(cache=True, nogil=True)
def restart_window(r: Any, t: float, q: float, lag_prior: float) -> None:
    """Begin a new stillness window at this sample."""
    r.still_since = t
    r.still_q = q
    r.still_sum = q
    r.still_n = 1
    r.still_time = 0.0
    r.c_lo = np.inf
    r.c_hi = -np.inf
    r.missing = 0.0
    r.suspect_since = 0.0
    r.lag_used = r.lag_high if r.lag_known else lag_prior
    r.lag_low_used = r.lag_low if r.lag_known else 0.0
    r.contradictions = 0
    r.high_effort = False


@numba.njit(cache=True, nogil=True)
def least_band(r: Any, s: Any) -> float:
    """Half width inside which a joint stands still, before any commanded motion counts."""
    quantum = r.quantum if r.quantum < r.slack else 0.0
    return max(s.noise_factor * noise_of(r) + 1.2 * quantum, r.still_least)


@numba.njit(cache=True, nogil=True)
def observe_stillness(
    r: Any, s: Any, ring_t: Array, ring_c: Array, t: float, q: float, v: float, lag_prior: float
) -> bool:
    """Take one accepted sample; return True where it broke the window (the joint moved)."""
    base = least_band(r, s)
    r.band = max(base, s.still_fraction * r.missing)
    lasting = t - r.missing_since if r.missing > _BEGUN * r.threshold else 0.0
    slack = slack_of(r, s.slack_unproved_factor, lasting)
    r.threshold = s.sensitivity * (slack + 3.0 * base)
    if r.still_n == 0:
        restart_window(r, t, q, lag_prior)
        return True
    if abs(q - r.still_q) > r.band:
        restart_window(r, t, q, lag_prior)
        return True
    dt = t - r.t_1
    r.still_n += 1
    r.still_sum += q
    r.still_time += min(dt, 3.0 * r.period) if r.period > 0.0 else dt
    if r.still_n <= _ANCHOR_SAMPLES:
        r.still_q = r.still_sum / r.still_n
    if r.ring_n == 0:
        return False
    tau = t - r.lag_used
    if tau >= r.still_since - r.lag_low_used:
        c = command_at(r, ring_t, ring_c, tau)
        if not np.isnan(c):
            r.c_lo = min(r.c_lo, c)
            r.c_hi = max(r.c_hi, c)
            if r.missing <= _BEGUN * r.threshold:
                # Until the command leaves, the joint may have settled or sagged: it has to stand
                # still from here on.
                r.missing_since = t
                r.still_q = r.late_mean
            r.missing = r.c_hi - r.c_lo
    if not np.isnan(v) and abs(r.command_speed) >= r.moving_speed:
        # A velocity that lives on and is no filter's tail contradicts the standing position.
        same_way = v * r.command_speed > 0.5 * r.command_speed * r.command_speed
        tail = abs(v) < 0.999 * abs(r.v)
        r.contradictions = r.contradictions + 1 if same_way and not tail else 0
    return False


@numba.njit(cache=True, nogil=True)
def effort_speaks(r: Any, s: Any, effort: float) -> None:
    """Note effort beyond everything seen in healthy motion; lowers the threshold once."""
    if np.isnan(effort) or r.effort_n < 200:
        return
    if abs(effort) > s.effort_factor * r.effort_envelope:
        r.high_effort = True


@numba.njit(cache=True, nogil=True)
def learn_effort(r: Any, effort: float, dt: float) -> None:
    """Learn the largest effort of healthy motion."""
    if np.isnan(effort):
        return
    r.effort_n += 1
    r.effort_envelope = max(abs(effort), r.effort_envelope * (1.0 - min(dt, 1.0) / 600.0))


@numba.njit(cache=True, nogil=True)
def lock_level(r: Any) -> float:
    """Evidence for a lock: 1 and above speaks for it once the confirm window has passed."""
    if r.still_n < 2 or r.threshold <= 0.0:
        return 0.0
    share = _HIGH_EFFORT_SHARE if r.high_effort else 1.0
    return r.missing / (share * r.threshold)
