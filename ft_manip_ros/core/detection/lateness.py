"""Compiled: the lag with which a healthy joint would have stood still so long, if there is one.

A joint that follows its command by some lag L shows in its stillness window, from s to t, what the
command showed from s - L to t - L. So the motion that it misses is the least, over all believable
L, of the command's range there: a joint that rests late at its goal, however late, misses nothing,
and one that stops on its way misses everything, whatever its lag. No lag has to be known for that.

The lags from 0 to ``lag_used`` are looked at in cells. All lags of a cell share the command from
s - (its least lag) to t - (its greatest), so its range there is never more than any of them gives.

A joint that was seen to follow tells more: what is not where a lag would have it, or did not come
there as that lag's command did, does not follow by that lag. Lags that the joint's place or its
way refute do not count, unless all of them are refuted. On the way at one speed all lags pass,
and miss alike; a joint that stops while its command gets faster or slower cannot be late by a lag
of another speed.

While the command rests its lag may change unseen, over a tool that is picked up or a bus that gets
busy. So once it has rested for ``lag_used``, the cells go on from there, with what the best of
them missed so far.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.detection.layout import CELLS, NO_TIME, RING
from ft_manip_ros.core.detection.tracking import command_at

Array = NDArray[np.float64]

# Rows of a joint's cells: range of the command; its speed along the joint's way as the window
# began; 1 where the joint was, and came, as these lags would have it then, otherwise 0.
LOW: Final = 0
HIGH: Final = 1
SPEED: Final = 2
BELIEVED: Final = 3

_WAY_TIME: Final = 0.05  # s at least, over which the joint's way is compared with its command's
_WAY_SHARE: Final = 0.3  # of its command's way that it may differ by, and
_WAY_BANDS: Final = 3.0  # half widths of stillness more
_SPEED_TIME: Final = 0.04  # s over which the command's speed is measured
_STRAIGHT_ON: Final = 0.6  # of its speed before, at least, or the command is turning or arriving


@kernel
def _way_speed(r: Any, ring_t: Array, ring_c: Array, t: float) -> float:
    """Speed of the command at ``t`` along the joint's way, from the past; NaN where unknown."""
    span = max(_SPEED_TIME, 1.5 * r.period)
    step = command_at(r, ring_t, ring_c, t) - command_at(r, ring_t, ring_c, t - span)
    return r.way * step / span


@kernel
def remember_way(r: Any, t: float, q: float) -> None:
    """Keep where the joint was at least `_WAY_TIME` ago; after a gap nothing is known."""
    if r.still_n == 0:
        r.before_t = NO_TIME
        r.anchor_t, r.anchor_q = t, q
    elif t - r.anchor_t >= _WAY_TIME:
        r.before_t, r.before_q = r.anchor_t, r.anchor_q
        r.anchor_t, r.anchor_q = t, q


@kernel
def _came_so(
    r: Any, ring_t: Array, ring_c: Array, least: float, greatest: float, margin: float
) -> bool:
    """Tell whether a lag of a cell explains the joint's way until its window began."""
    way = r.still_q - r.came_q
    low, high = np.inf, -np.inf
    for lag in (least, greatest):
        wanted = command_at(r, ring_t, ring_c, r.still_since - lag) - command_at(
            r, ring_t, ring_c, r.came_t - lag
        )
        if np.isnan(wanted):
            return True
        low, high = min(low, wanted), max(high, wanted)
    margin += _WAY_SHARE * max(abs(low), abs(high))
    return bool(low - margin <= way <= high + margin)


@kernel
def begin_cells(
    r: Any, ring_t: Array, ring_c: Array, cells: Array, t: float, reach: float, base: float
) -> None:
    """Fill the cells with what the history holds since ``weigh_since``.

    Parameters
    ----------
    reach
        Distance (rad or m) of the joint from where a lag would have it that refutes that lag.
    base
        Half width (rad or m) inside which the joint stands still.
    """
    where = r.still_q - r.offset
    # What rested since may be late by another lag than it came with.
    came = r.weigh_since == r.still_since and r.came_t > NO_TIME
    margin = r.slack_least + _WAY_BANDS * base
    width = r.lag_used / CELLS
    for i in range(CELLS):
        begin = r.weigh_since - i * width
        end = t - (i + 1) * width
        low, high = r.rest_lo, r.rest_hi
        if end >= begin:
            for c in (
                command_at(r, ring_t, ring_c, begin),
                command_at(r, ring_t, ring_c, end),
            ):
                if not np.isnan(c):
                    low, high = min(low, c), max(high, c)
            for back in range(r.ring_n):
                k = (r.ring_head - 1 - back) % RING
                if ring_t[k] <= begin:
                    break
                if ring_t[k] < end:
                    low, high = min(low, ring_c[k]), max(high, ring_c[k])
        cells[LOW, i] = low
        cells[HIGH, i] = high
        cells[SPEED, i] = _way_speed(r, ring_t, ring_c, begin)
        cells[BELIEVED, i] = 1.0
        if r.lag_known:
            early = command_at(r, ring_t, ring_c, begin)
            late = command_at(r, ring_t, ring_c, begin - width)
            # Comparisons with an unknown command are false.
            if where < min(early, late) - reach or where > max(early, late) + reach:
                cells[BELIEVED, i] = 0.0
        if came and not _came_so(r, ring_t, ring_c, i * width, (i + 1) * width, margin):
            cells[BELIEVED, i] = 0.0


@kernel
def advance_cells(r: Any, ring_t: Array, ring_c: Array, cells: Array, t: float) -> None:
    """Let the cells take the command up to now."""
    width = r.lag_used / CELLS
    for i in range(CELLS):
        begin = r.weigh_since - i * width
        end = t - (i + 1) * width
        if end < begin:
            continue
        c = command_at(r, ring_t, ring_c, end)
        if not np.isnan(c):
            if cells[LOW, i] > cells[HIGH, i]:
                # The first motion that this cell sees.
                first = command_at(r, ring_t, ring_c, begin)
                if not np.isnan(first):
                    cells[LOW, i] = cells[HIGH, i] = first
            cells[LOW, i] = min(cells[LOW, i], c)
            cells[HIGH, i] = max(cells[HIGH, i], c)


@kernel
def rest_cells(r: Any, cells: Array, t: float) -> None:
    """Go on from a command that has rested long enough for every lag to have seen it."""
    best = 0
    for i in range(1, CELLS):
        if cells[HIGH, i] - cells[LOW, i] < cells[HIGH, best] - cells[LOW, best]:
            best = i
    for i in range(CELLS):
        cells[LOW, i] = cells[LOW, best]
        cells[HIGH, i] = cells[HIGH, best]
        cells[SPEED, i] = 0.0
        cells[BELIEVED, i] = 1.0
    r.weigh_since = t


@kernel
def weigh_cells(
    r: Any,
    ring_t: Array,
    ring_c: Array,
    cells: Array,
    t: float,
    of_start: float,
    of_way: float,
) -> None:
    """Note the motion missing, and its threshold, for the lag that says least.

    Parameters
    ----------
    of_start
        Threshold of a joint that starts, turns or arrives, rad or m.
    of_way
        That of a joint on its way, while its command goes straight on.
    """
    width = r.lag_used / CELLS
    least = np.inf
    nowhere = True
    for i in range(CELLS):
        nowhere = nowhere and cells[BELIEVED, i] == 0.0
    for i in range(CELLS):
        if cells[BELIEVED, i] == 0.0 and not nowhere:
            continue
        missing = max(cells[HIGH, i] - cells[LOW, i], 0.0)
        straight = cells[SPEED, i] >= r.moving_speed
        if straight:
            now = _way_speed(r, ring_t, ring_c, t - (i + 1) * width)
            straight = now >= _STRAIGHT_ON * cells[SPEED, i]
            if not straight:
                cells[SPEED, i] = 0.0
        threshold = of_way if straight else of_start
        if missing / threshold < least:
            least = missing / threshold
            r.missing = missing
            r.threshold = threshold
            r.through = straight
