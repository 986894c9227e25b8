"""Compiled: how far the command has moved on while the joint stood still.

The window begins at the last sample at which the joint moved. While it lasts, motion of the
command that no believable lag explains (`lateness`) is motion that a healthy joint must have
shown: ``missing``, compared with ``threshold``. Steady offsets drop out, since only motion is
compared. The threshold holds what a healthy joint may swallow (`slack`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.detection.lateness import (
    advance_cells,
    begin_cells,
    remember_way,
    rest_cells,
    weigh_cells,
)
from ft_manip_ros.core.detection.layout import NO_TIME
from ft_manip_ros.core.detection.slack import (
    note_swallowed,
    swallowed_at_start,
    threshold_of_start,
    threshold_of_way,
)
from ft_manip_ros.core.detection.tracking import command_at, noise_of

Array = NDArray[np.float64]

_ANCHOR_SAMPLES = 4  # averaged to say where the joint stands
_BEGUN = 0.1  # of the slack, at which the evidence begins
_HIGH_EFFORT_SHARE = 0.7  # of the threshold is enough when the effort speaks too


@kernel
def lock_level(r: Any) -> float:
    """Evidence for a lock: 1 and above speaks for it once the confirm window has passed."""
    if r.still_n < 2 or r.threshold <= 0.0:
        return 0.0
    share = _HIGH_EFFORT_SHARE if r.high_effort else 1.0
    return r.missing / (share * r.threshold)


@kernel
def restart_window(r: Any, t: float, q: float, lag_prior: float) -> None:
    """Begin a new stillness window at this sample."""
    r.way = 1.0 if q > r.still_q else -1.0
    r.through = False
    r.came_t = r.before_t
    r.came_q = r.before_q
    r.still_since = t
    r.still_q = q
    r.still_sum = q
    r.still_n = 1
    r.still_time = 0.0
    r.weighing = False
    r.weigh_since = t
    r.look_lo = np.inf
    r.look_hi = -np.inf
    r.look_lag = r.lag
    r.rest_lo = np.inf
    r.rest_hi = -np.inf
    r.missing = 0.0
    r.missing_since = t
    r.suspect_since = 0.0
    r.lag_used = max(r.lag_high, lag_prior) if r.lag_known else lag_prior
    r.contradictions = 0
    r.high_effort = False
    r.tool_word = 0
    r.tool_asked = NO_TIME
    if r.stuck:
        # Whether it counts from where it should, it has to show by following.
        r.stuck = False
        r.proving = True
        r.untrusted = True


@kernel
def least_band(r: Any, s: Any) -> float:
    """Half width inside which a joint stands still, before any commanded motion counts."""
    quantum = r.quantum if r.quantum < r.slack else 0.0
    return max(s.noise_factor * noise_of(r) + 1.2 * quantum, r.still_least)


@kernel
def _weigh(
    r: Any,
    s: Any,
    load: float,
    base: float,
    ring_t: Array,
    ring_c: Array,
    cells: Array,
    t: float,
) -> None:
    """Weigh the motion that is missing at this sample of a standing joint."""
    begun = _BEGUN * r.slack
    rested = r.command_rest_since + r.lag_used
    rests = t >= rested and r.weigh_since < rested
    if not r.weighing:
        # One lag is looked at first: what it explains needs no others.
        since = r.still_since if r.still_n == 2 else t
        for x in (since, t):
            c = command_at(r, ring_t, ring_c, x - r.look_lag)
            if not np.isnan(c):
                r.look_lo = min(r.look_lo, c)
                r.look_hi = max(r.look_hi, c)
        r.missing = max(r.look_hi - r.look_lo, 0.0)
        if r.missing > begun:
            reach = r.slack + 1.5 * load + 2.0 * r.envelope + 3.0 * base
            begin_cells(r, ring_t, ring_c, cells, t, reach, base)
            r.weighing = True
        elif rests:
            r.weigh_since = t
            r.rest_lo, r.rest_hi = r.look_lo, r.look_hi
    else:
        advance_cells(r, ring_t, ring_c, cells, t)
        if rests:
            rest_cells(r, cells, t)
    lasting = t - r.missing_since
    of_start = s.sensitivity * threshold_of_start(
        r, s.slack_unproved_factor, load, base, lasting, swallowed_at_start(r)
    )
    r.threshold = of_start
    if r.weighing:
        of_way = s.sensitivity * threshold_of_way(r, load, base, t - r.still_since, r.swallow_way)
        weigh_cells(r, ring_t, ring_c, cells, t, of_start, of_way)
    if r.missing <= begun:
        # Until the command leaves, the joint may have settled or sagged: it has to stand still
        # from here on.
        r.missing_since = t
        r.still_q = r.late_mean


@kernel
def observe_stillness(
    r: Any,
    s: Any,
    load: float,
    ring_t: Array,
    ring_c: Array,
    cells: Array,
    t: float,
    q: float,
    v: float,
) -> bool:
    """Take one accepted sample; return True where it broke the window (the joint moved)."""
    remember_way(r, t, q)
    base = least_band(r, s)
    r.band = max(base, s.still_fraction * r.missing)
    moved = abs(q - r.still_q) > r.band
    if r.still_n == 0 or moved:
        if r.still_n > 0:
            note_swallowed(r, s, load, base, t, q)
        restart_window(r, t, q, s.lag_prior_s)
        r.threshold = s.sensitivity * threshold_of_start(
            r, s.slack_unproved_factor, load, base, 0.0, swallowed_at_start(r)
        )
        return True
    dt = t - r.t_1
    r.still_n += 1
    r.still_sum += q
    r.still_time += min(dt, 3.0 * r.period) if r.period > 0.0 else dt
    if r.still_n <= _ANCHOR_SAMPLES:
        r.still_q = r.still_sum / r.still_n
    if r.ring_n == 0:
        return False
    _weigh(r, s, load, base, ring_t, ring_c, cells, t)
    if not np.isnan(v) and abs(r.command_speed) >= r.moving_speed:
        # A velocity that lives on and is no filter's tail contradicts the standing position.
        same_way = v * r.command_speed > 0.5 * r.command_speed * r.command_speed
        tail = abs(v) < 0.999 * abs(r.v)
        r.contradictions = r.contradictions + 1 if same_way and not tail else 0
    return False


@kernel
def effort_speaks(r: Any, s: Any, effort: float) -> None:
    """Note effort beyond everything seen in healthy motion; lowers the threshold once."""
    if np.isnan(effort) or r.effort_n < 200:
        return
    if abs(effort) > s.effort_factor * r.effort_envelope:
        r.high_effort = True


@kernel
def learn_effort(r: Any, effort: float, dt: float) -> None:
    """Learn the largest effort of healthy motion."""
    if np.isnan(effort):
        return
    r.effort_n += 1
    r.effort_envelope = max(abs(effort), r.effort_envelope * (1.0 - min(dt, 1.0) / 600.0))
