"""Compiled: how much commanded motion a healthy joint swallows, learned from what it swallowed.

Backlash and friction swallow motion where a joint starts or turns, hardly any while it goes on in
one direction; a changing load may hide motion that is slow enough. So there are two slacks: that
of the *way*, for a joint that was following until its window began and whose command went
straight on, and that of the *start*, for everything else.
"""

from __future__ import annotations

from typing import Any

import numba

_TRUST_AFTER = 5.0  # s of motion until a joint's own tracking replaces the prior slack
_STARTS = 2  # starts until a joint's own ones replace the prior slack
_MARGIN = 2.0  # times what was ever swallowed
_LOAD_TIME = 0.05  # s within which a load may come to hide motion of the prior slack
_WANDER = 1.5  # s within which loads do not change much
_LOAD_MARGIN = 1.5
_MOST_LOAD = 5.0  # times the prior slack
_MEMORY = 300.0  # s
_REST = 0.2  # s of stillness that make the next motion a start
_NEWS = 0.1  # of the slack: less is not looked at
_CAUGHT_UP = 0.5  # of the missing motion
_CATCH_TIME = 2.0  # s
_JERK = 0.75  # of the slack, swallowed on the way
_SUSPECTED = 0.5  # level


@numba.njit(cache=True, nogil=True)
def load_of(r: Any, load: float, lasting: float) -> float:
    """Motion that a changing load may hide for ``lasting`` (s); ``load``: sag seen at rest."""
    most = min(max(r.slack, _LOAD_MARGIN * load), _MOST_LOAD * r.slack)
    hidden = min(r.slack * lasting / _LOAD_TIME, most)
    if lasting > _WANDER:
        # On joints whose tracking is seen to wander, slow loads hide more.
        slow = r.slack * lasting / _WANDER
        hidden = max(hidden, min(_MARGIN * r.envelope, slow))
    return hidden


@numba.njit(cache=True, nogil=True)
def slack_of_start(r: Any, unproved_factor: float, load: float, lasting: float) -> float:
    """Slack of a joint that starts or turns (rad or m).

    Parameters
    ----------
    lasting
        Time (s) for which its command has been moving without it.
    """
    if r.ring_n == 0:
        return r.slack
    prior = r.slack
    if r.starts < _STARTS:
        prior *= unproved_factor
    return max(prior, max(_MARGIN * r.swallow_start, load_of(r, load, lasting)))


@numba.njit(cache=True, nogil=True)
def slack_of_way(r: Any, load: float, lasting: float) -> float:
    """Slack of a joint on its way (rad or m) that has been standing still for ``lasting`` (s)."""
    slack = max(r.slack_least, _MARGIN * r.swallow_way)
    prior = r.slack * max(0.0, 1.0 - r.moved_s / _TRUST_AFTER)
    return max(max(slack, prior), load_of(r, load, lasting))


@numba.njit(cache=True, nogil=True)
def note_swallowed(r: Any, t: float, q: float, level: float) -> None:
    """Remember what was missing as a window ends, until the joint is seen to have caught up."""
    if not r.through and abs(r.command_speed) >= r.moving_speed:
        rested = r.still_time > _REST
        if rested:
            r.started = t
            r.start_late = t - r.departed
        # Before its lag is known, nobody can tell what it swallows.
        if r.lag_known and (rested or (q - r.still_q) * r.way < 0.0):
            r.starts += 1
    missing = max(r.span, r.ahead)
    if missing <= max(_NEWS * r.slack, 2.0 * r.band):
        return
    if r.catch_missing > missing and t - r.catch_t < _CATCH_TIME:
        return
    r.catch_q = r.still_q
    r.catch_missing = missing
    r.catch_level = level
    r.catch_through = r.through
    r.catch_t = t


@numba.njit(cache=True, nogil=True)
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
    jerk = r.catch_level >= _SUSPECTED or (r.catch_through and r.catch_missing > _JERK * r.slack)
    r.catch_missing = 0.0
    return bool(jerk)


@numba.njit(cache=True, nogil=True)
def fade_swallowed(r: Any, dt: float) -> None:
    """Forget slowly what was swallowed long ago."""
    fading = 1.0 - min(dt, 1.0) / _MEMORY
    r.swallow_way *= fading
    r.swallow_start *= fading
    r.rest_wander *= fading
