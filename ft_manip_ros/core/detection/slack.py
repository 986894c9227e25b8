"""Compiled: how much commanded motion a healthy joint swallows, learned from what it swallowed.

Backlash and friction swallow motion where a joint starts or turns, hardly any while it goes on in
one direction; a changing load may hide motion that is slow enough. So there are two thresholds:
that of the *way*, for a joint whose command went straight on, and that of the *start*, for
everything else.
"""

from __future__ import annotations

from typing import Any

from ft_manip_ros.core.compiled import kernel

_BANDS = 3.0  # half widths of stillness that count as nothing
_WAY_BANDS = 4.0  # on the way a step of the encoder more is missing
_TRUST_AFTER = 5.0  # s of motion until a joint's own tracking replaces the prior slack
_STARTS = 2  # starts until a joint counts as proved
_MANY_STARTS = 10  # starts until its own ones replace the prior slack
_OWN_STARTS = 0.5  # of the prior slack, at least, then
_MARGIN = 2.0  # times what was ever swallowed
_TURN = 1.5  # times what was swallowed on the way
_LOAD_TIME = 0.05  # s within which a load may come to hide motion of the prior slack
_LOAD_MARGIN = 1.5
_MOST_LOAD = 1.75  # times the prior slack: more, to within a band, no load hides
_MOST_SEEN = 3.0  # the same of an arm whose loads were seen to sag
_SLOW = (0.2, 0.5)  # s from which on a load never seen before may hide more, and the most
_SLOW_SHARE = 0.375  # of the prior slack more, then, and
_SLOW_BANDS = 2.0  # half widths of stillness: a wide band hides how the load comes
_LOAD_BANDS = 1.5  # of them count as nothing beside a load
_MEMORY = 300.0  # s
_REST = 0.2  # s of stillness that make the next motion a start
_NEWS = 0.1  # of the slack: less is not looked at
_CAUGHT_UP = 0.5  # of the missing motion
_CATCH_TIME = 2.0  # s
_SUSPECTED = 0.5  # level


@kernel
def load_of(r: Any, load: float, base: float, lasting: float) -> float:
    """Motion (rad or m) that a changing load may hide, to within the band.

    Parameters
    ----------
    load
        Sag seen at rest, rad or m.
    base
        Half width (rad or m) inside which the joint stands still.
    lasting
        Time (s) for which the motion is missing.
    """
    slow = min(max(lasting - _SLOW[0], 0.0) / (_SLOW[1] - _SLOW[0]), 1.0)
    most = r.slack + (_SLOW_SHARE * r.slack + _SLOW_BANDS * base) * slow
    most = min(most, _MOST_LOAD * r.slack)
    most = max(most, min(_LOAD_MARGIN * load, _MOST_SEEN * r.slack))
    return min(r.slack * lasting / _LOAD_TIME, most) + _LOAD_BANDS * base


@kernel
def threshold_of_start(
    r: Any, unproved_factor: float, load: float, base: float, lasting: float, swallowed: float
) -> float:
    """Missing motion (rad or m) that locks a joint that starts, turns or arrives.

    Parameters
    ----------
    unproved_factor
        Multiplies the slack of a joint that was not yet seen to set out.
    load
        Sag seen at rest, rad or m.
    base
        Half width (rad or m) inside which the joint stands still.
    lasting
        Time (s) for which its command has been moving without it.
    swallowed
        Motion (rad or m) that such a joint really swallowed and then made up for.
    """
    slack = r.slack
    if r.starts < _STARTS:
        slack *= unproved_factor
    elif r.starts >= _MANY_STARTS:
        slack *= _OWN_STARTS
    slack = max(slack, _MARGIN * swallowed)
    return max(slack + _BANDS * base, load_of(r, load, base, lasting))


@kernel
def threshold_of_way(r: Any, load: float, base: float, lasting: float, swallowed: float) -> float:
    """Missing motion (rad or m) that locks a joint on its way; parameters as for the start."""
    slack = max(r.slack_least, _MARGIN * swallowed)
    slack = max(slack, r.slack * max(0.0, 1.0 - r.moved_s / _TRUST_AFTER))
    return max(slack + _WAY_BANDS * base, load_of(r, load, base, lasting))


@kernel
def swallowed_at_start(r: Any) -> float:
    """Motion (rad or m) that the joint really swallowed where it starts, turns or arrives.

    What sticks on its way does so there, too, and at a turn on either side.
    """
    return max(r.swallow_start, _TURN * r.swallow_way)


@kernel
def note_swallowed(r: Any, s: Any, load: float, base: float, t: float, q: float) -> None:
    """Remember what was missing as a window ends, until the joint is seen to have caught up.

    How much that is for a joint, is measured by what one may swallow that was never seen to.
    """
    if not r.through and abs(r.command_speed) >= r.moving_speed:
        rested = r.still_time > _REST
        if rested:
            r.started = t
            r.start_late = t - r.departed
        # Before its lag is known, nobody can tell what it swallows.
        if r.lag_known and (rested or (q - r.still_q) * r.way < 0.0):
            r.starts += 1
    missing = r.missing
    if missing <= max(_NEWS * r.slack, 2.0 * r.band):
        return
    if r.catch_missing > missing and t - r.catch_t < _CATCH_TIME:
        return
    r.catch_q = r.still_q
    r.catch_missing = missing
    if r.through:
        usual = threshold_of_way(r, load, base, t - r.still_since, 0.0)
    else:
        lasting = t - r.missing_since
        usual = threshold_of_start(r, s.slack_unproved_factor, load, base, lasting, 0.0)
    r.catch_level = missing / (s.sensitivity * usual)
    r.catch_through = r.through
    r.catch_t = t


@kernel
def learn_swallowed(r: Any, t: float, q: float) -> bool:
    """Learn what the joint swallowed once it has caught up; True where that was a jerk."""
    if r.catch_missing <= 0.0:
        return False
    if t - r.catch_t > _CATCH_TIME:
        r.catch_missing = 0.0
        return False
    if abs(q - r.catch_q) < _CAUGHT_UP * r.catch_missing:
        return False
    if r.catch_through:
        r.swallow_way = max(r.swallow_way, r.catch_missing)
    else:
        r.swallow_start = max(r.swallow_start, r.catch_missing)
    r.catch_missing = 0.0
    return bool(r.catch_level >= _SUSPECTED)


@kernel
def fade_swallowed(r: Any, dt: float) -> None:
    """Forget slowly what was swallowed long ago."""
    fading = 1.0 - min(dt, 1.0) / _MEMORY
    r.swallow_way *= fading
    r.swallow_start *= fading
    r.rest_wander *= fading
