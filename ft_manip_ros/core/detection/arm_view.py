"""Compiled: what only the whole arm can tell: stops, foreign commands, silence, repetition."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.detection.layout import NO_TIME, Memory
from ft_manip_ros.core.detection.machine import (
    LOCK_AWAITS_TOOL,
    LOCK_CONFIRMED,
    LOCK_ENCODER_STUCK,
    LOCK_FIRST,
    LOCK_HELD_BACK,
    LOCK_UNSENSED,
    LOCKED,
    RUNAWAY,
)
from ft_manip_ros.core.detection.motion import QUIET
from ft_manip_ros.core.detection.states import Cause, ToolWord
from ft_manip_ros.core.detection.stillness import lock_level
from ft_manip_ros.core.detection.tracking import command_at

Array = NDArray[np.float64]

_NO_SAMPLES: Final = int(Cause.NO_SAMPLES)
_STAMPS: Final = int(Cause.STAMPS_NOT_ADVANCING)
_REPEATS: Final = int(Cause.PAYLOAD_REPEATS)
_UNCOMMANDED: Final = int(Cause.MOVES_UNCOMMANDED)
_RECENT: Final = 0.5  # s
_START_LATE: Final = 0.5  # s by which a joint that set out late may trail its command
_LATE_MARGIN: Final = 1.2
_LATE_SAMPLES: Final = 5
_LATE_TIME: Final = 0.1  # s
_FLICKER_SAMPLES: Final = 30
_FLICKER_SHARE: Final = 0.2
_REPEATS_IN_MOTION: Final = 8
_FIRST_LEVEL: Final = 0.5
_FEW_REPEATS: Final = 0.05  # share of messages below which repetition is news
_ENOUGH_MESSAGES: Final = 200
_LOG_IMPOSSIBLE: Final = -40.0
_TOOL_SILENT: Final = 0.5  # s without a pose of the tool after which it says nothing
_UNASKED: Final = int(ToolWord.UNASKED)
_AWAITED: Final = int(ToolWord.AWAITED)
_MOVED: Final = int(ToolWord.MOVED)


@kernel
def lock_stage_of(
    memory: Memory, i: int, stage: int, fresh: bool, repeated: bool, live: bool
) -> int:
    """Hold a confirmed lock back while the arm as a whole says something else.

    Where no commanded joint moves, the arm is stopped, has not got its command yet or runs others;
    where the message itself repeats, nothing is known of any joint.
    """
    r = memory.joints[i]
    if r.stuck:
        return LOCK_ENCODER_STUCK
    if stage != LOCK_CONFIRMED:
        return stage
    if not fresh or repeated:
        return LOCK_FIRST
    if r.changes_ever == 0 and r.q == 0.0 and _others_flicker(memory, i):
        return LOCK_UNSENSED
    if r.ring_n == 0:
        return stage if _others_move(memory, i) else LOCK_FIRST
    return _tool_view(r, memory.arm[0]) if _executed(memory, i, live) else LOCK_HELD_BACK


@kernel
def _tool_view(r: Any, arm: Any) -> int:
    """What the tool's motion makes of a confirmed lock; waits for its word, but not for long."""
    if r.tool_word == _MOVED:
        r.stuck = True
        return LOCK_ENCODER_STUCK
    if r.tool_word != _UNASKED and r.tool_word != _AWAITED:
        return LOCK_CONFIRMED
    if r.tool_asked == NO_TIME:
        r.tool_asked = r.t
    heard = r.t - arm.tool_t <= _TOOL_SILENT
    return LOCK_AWAITS_TOOL if heard and r.t - r.tool_asked < arm.tool_wait else LOCK_CONFIRMED


@kernel
def _executed(memory: Memory, i: int, live: bool) -> bool:
    """Tell whether the arm is seen to execute the command that joint ``i`` does not follow.

    Another joint that follows its own command shows that. Where both had to set out together and
    it did so late, because the arm took up its command later than was thought, joint ``i`` is
    granted that time, too. A joint that has moved since its command left rest shows it itself.
    """
    s = memory.settings[0]
    r = memory.joints[i]
    if s.not_executing_joints == 0.0:
        return True
    lateness = np.inf
    commanded = 1
    for j in range(memory.joints.shape[0]):
        other = memory.joints[j]
        if j == i or not other.has_sample or r.t - other.t > _RECENT or other.ring_n == 0:
            continue
        if other.state == LOCKED or other.state == RUNAWAY:
            continue
        if other.runaway_n > 0:
            return False
        asked = other.missing > 0.25 * other.threshold
        if not asked and r.t - other.command_rest_since > _RECENT + other.lag_high:
            continue
        if abs(other.command_speed) >= other.moving_speed or asked:
            commanded += 1
        if other.still_since >= r.suspect_since and _follows(memory, j):
            together = other.started >= r.departed and other.departed > r.departed - _RECENT
            late = other.start_late if together else 0.0
            lateness = min(lateness, late)
    if lateness < np.inf:
        return r.taken_up or r.t - r.reached_since >= _LATE_MARGIN * lateness - r.lag_used
    if commanded >= s.not_executing_joints and commanded > 1:
        return False
    # Nobody else is commanded: the message may still be on its way to the arm.
    waited = r.t - r.departed - r.lag_high >= s.start_timeout_s
    return live or r.taken_up or r.high_effort or waited


@kernel
def _follows(memory: Memory, j: int) -> bool:
    """Tell whether a joint is where one of its believable lags would have it."""
    r = memory.joints[j]
    if not r.lag_known:
        return r.way * r.command_speed >= 0.0
    ring_t, ring_c = memory.ring_t[j], memory.ring_c[j]
    early = command_at(r, ring_t, ring_c, r.t - r.lag_low)
    late = command_at(r, ring_t, ring_c, r.t - r.lag_high)
    if np.isnan(early) or np.isnan(late):
        return True
    reach = r.slack + 2.0 * r.envelope + 3.0 * r.band + _START_LATE * abs(r.command_speed)
    where = r.q - r.offset
    return min(early, late) - reach <= where <= max(early, late) + reach


@kernel
def _others_flicker(memory: Memory, i: int) -> bool:
    """Tell whether another encoder's reading changes although its joint rests."""
    for j in range(memory.joints.shape[0]):
        other = memory.joints[j]
        flickers = other.changes > _FLICKER_SHARE * other.comparisons
        if j != i and other.comparisons >= _FLICKER_SAMPLES and flickers:
            return True
    return False


@kernel
def _others_move(memory: Memory, i: int) -> bool:
    """Tell whether another joint moved in the later half of this joint's stillness."""
    r = memory.joints[i]
    middle = 0.5 * (r.still_since + r.t)
    for j in range(memory.joints.shape[0]):
        other = memory.joints[j]
        if j != i and other.has_moved and other.still_since > middle:
            return True
    return False


@kernel
def runaway_of(memory: Memory, i: int, cause: int, live: bool) -> int:
    """Drop motion at rest when several joints show it and commands are not streamed.

    Then somebody else commands the arm, out of this monitor's sight.
    """
    if cause != _UNCOMMANDED or live:
        return cause
    for j in range(memory.joints.shape[0]):
        other = memory.joints[j]
        if j != i and abs(other.q - other.drift_q) > 0.2 * other.drift:
            return QUIET
    return cause


@kernel
def stale_cause(r: Any, s: Any, arm: Any, repeated: bool, t: float) -> int:
    """Return the `Cause` why a joint's samples are not fresh, or QUIET."""
    if repeated:
        return _REPEATS
    if r.late_run >= _LATE_SAMPLES and r.late_run * r.period >= _LATE_TIME:
        return _STAMPS
    since = r.t if r.has_sample else arm.first
    if arm.now - since > max(s.stale_s, s.stale_periods * r.period):
        return _NO_SAMPLES
    return QUIET


@kernel
def watch_payload(
    memory: Memory, t: float, q: Array, v: Array, e: Array, present: NDArray[np.bool_]
) -> bool:
    """Tell whether the whole payload repeats bit for bit although it should not.

    That is on an arm whose payload never does so at rest, or while several joints should move.
    """
    arm, raw = memory.arm[0], memory.raw
    same = True
    for j in range(q.shape[0]):
        if not present[j]:
            continue
        # NaN, not given, is equal to itself here.
        same = (
            same
            and (q[j] == raw[j, 0])
            and (v[j] == raw[j, 1] or (np.isnan(v[j]) and np.isnan(raw[j, 1])))
            and (e[j] == raw[j, 2] or (np.isnan(e[j]) and np.isnan(raw[j, 2])))
        )
        raw[j, 0], raw[j, 1], raw[j, 2] = q[j], v[j], e[j]
    at_rest = True
    missing_motion = 0
    for j in range(q.shape[0]):
        r = memory.joints[j]
        at_rest = at_rest and r.still_n > 2
        if lock_level(r) >= _FIRST_LEVEL and r.state != LOCKED:
            # A lone commanded joint that stands still may be locked, and the others at rest.
            missing_motion += 1 if r.ring_n > 0 else 2
    if not same:
        if at_rest:
            arm.rests += arm.repeat_run + 1
            arm.repeats += arm.repeat_run
            arm.longest_repeat = max(arm.longest_repeat, t - arm.repeat_since)
        arm.repeat_run = 0
        arm.repeat_since = t
        return False
    arm.repeat_run += 1
    lasting = t - arm.repeat_since
    least = memory.settings[0].dead_s
    if missing_motion > 1 and arm.repeat_run >= _REPEATS_IN_MOTION and lasting >= least:
        return True
    if arm.rests < _ENOUGH_MESSAGES:
        return False
    chance = (arm.repeats + 1.0) / (arm.rests + 1.0)
    unlikely = arm.repeat_run * np.log(chance) < _LOG_IMPOSSIBLE
    return chance < _FEW_REPEATS and unlikely and lasting >= max(least, 5.0 * arm.longest_repeat)
