"""Compiled: how far the command has moved on while the joint stood still.

The window begins at the last sample at which the joint moved. While it lasts, motion of the
command in it is motion that a healthy joint must have shown. Two looks at it:

- the *span*: the range of the command where even the slowest believable tracking must have
  brought it to the joint, from ``still_since`` to ``t - lag_high``: a joint that comes to rest at
  its goal late, however late, misses nothing;
- *ahead*: how far the command went straight on since a joint on its way stopped. There an error
  of the lag hardly matters, since the speed is that of before.

Steady offsets drop out, since only motion is compared. Each has its slack (`slack`); the one that
says more speaks, as ``missing`` and ``threshold``.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.detection.slack import note_swallowed, slack_of_start, slack_of_way
from ft_manip_ros.core.detection.tracking import command_at, noise_of

Array = NDArray[np.float64]

_ANCHOR_SAMPLES = 4  # averaged to say where the joint stands
_BEGUN = 0.1  # share of the threshold at which the evidence begins
_BANDS = 3.0  # half widths of stillness that count as nothing
_MORE_BANDS = 4.0  # further ones in slow motion: a load matches a band the sooner the wider it is
_SLOW = 0.3  # s
_HIGH_EFFORT_SHARE = 0.7  # of the threshold is enough when the effort speaks too
_SPEED_TIME = 0.04  # s over which the command's speed is measured
_STRAIGHT_ON = 0.6  # of its speed before, at least, or the command is turning or arriving


@numba.njit(cache=True, nogil=True)
def lock_level(r: Any) -> float:
    """Evidence for a lock: 1 and above speaks for it once the confirm window has passed."""
    if r.still_n < 2 or r.threshold <= 0.0:
        return 0.0
    share = _HIGH_EFFORT_SHARE if r.high_effort else 1.0
    return r.missing / (share * r.threshold)


@numba.njit(cache=True, nogil=True)
def restart_window(r: Any, t: float, q: float, lag_prior: float) -> None:
    """Begin a new stillness window at this sample."""
    r.way = 1.0 if q > r.still_q else -1.0
    r.through = False
    r.ahead = 0.0
    r.still_since = t
    r.still_q = q
    r.still_sum = q
    r.still_n = 1
    r.still_time = 0.0
    r.c_lo = np.inf
    r.c_hi = -np.inf
    r.span = 0.0
    r.missing = 0.0
    r.suspect_since = 0.0
    r.lag_used = r.lag_high if r.lag_known else lag_prior
    r.contradictions = 0
    r.high_effort = False


@numba.njit(cache=True, nogil=True)
def least_band(r: Any, s: Any) -> float:
    """Half width inside which a joint stands still, before any commanded motion counts."""
    quantum = r.quantum if r.quantum < r.slack else 0.0
    return max(s.noise_factor * noise_of(r) + 1.2 * quantum, r.still_least)


@numba.njit(cache=True, nogil=True)
def _bands(lasting: float) -> float:
    return _BANDS + _MORE_BANDS * min(lasting / _SLOW, 1.0)


@numba.njit(cache=True, nogil=True)
def _speed_at(r: Any, ring_t: Array, ring_c: Array, t: float) -> float:
    """Speed of the command at ``t``, from the past only; NaN where unknown."""
    span = max(_SPEED_TIME, 1.5 * r.period)
    return (command_at(r, ring_t, ring_c, t) - command_at(r, ring_t, ring_c, t - span)) / span


@numba.njit(cache=True, nogil=True)
def _look_ahead(r: Any, load: float, ring_t: Array, ring_c: Array, t: float) -> float:
    """Note how far the command went straight on; return the slack of that, infinite if not."""
    if r.still_n == 2:
        r.c_begin = command_at(r, ring_t, ring_c, r.still_since - r.lag)
        r.begin_speed = r.way * _speed_at(r, ring_t, ring_c, r.still_since - r.lag)
        r.through = r.lag_known and r.begin_speed >= r.moving_speed
    if not r.through:
        return np.inf
    # Whatever its lag really is, a joint does not arrive while its command goes on as fast now.
    speed = r.way * _speed_at(r, ring_t, ring_c, t - r.lag)
    speed = min(speed, r.way * _speed_at(r, ring_t, ring_c, t))
    if not speed >= _STRAIGHT_ON * r.begin_speed:
        r.through = False
        r.ahead = 0.0
        return np.inf
    r.ahead = r.way * (command_at(r, ring_t, ring_c, t - r.lag) - r.c_begin)
    return slack_of_way(r, load, t - r.still_since)


@numba.njit(cache=True, nogil=True)
def observe_stillness(
    r: Any,
    s: Any,
    load: float,
    ring_t: Array,
    ring_c: Array,
    t: float,
    q: float,
    v: float,
    lag_prior: float,
) -> bool:
    """Take one accepted sample; return True where it broke the window (the joint moved)."""
    level = lock_level(r)
    base = least_band(r, s)
    r.band = max(base, s.still_fraction * r.missing)
    lasting = t - r.span_since if r.span > _BEGUN * r.slack else 0.0
    slack = slack_of_start(r, s.slack_unproved_factor, load, lasting)
    r.threshold = s.sensitivity * (slack + _bands(lasting) * base)
    if r.still_n == 0:
        restart_window(r, t, q, lag_prior)
        return True
    if abs(q - r.still_q) > r.band:
        note_swallowed(r, t, q, level)
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
    if tau >= r.still_since:
        c = command_at(r, ring_t, ring_c, tau)
        if not np.isnan(c):
            r.c_lo = min(r.c_lo, c)
            r.c_hi = max(r.c_hi, c)
            if r.span <= _BEGUN * r.slack and r.ahead <= _BEGUN * r.slack:
                # Until the command leaves, the joint may have settled or sagged: it has to stand
                # still from here on.
                r.span_since = t
                r.still_q = r.late_mean
            r.span = r.c_hi - r.c_lo
    slack = _look_ahead(r, load, ring_t, ring_c, t)
    r.missing = r.span
    ahead_threshold = s.sensitivity * (slack + _bands(t - r.still_since) * base)
    if r.ahead * r.threshold > r.span * ahead_threshold:
        r.missing = r.ahead
        r.threshold = ahead_threshold
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
