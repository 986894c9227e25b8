"""Compiled: the state machine of one joint, a pure function of its evidence.

latched        LOCKED, RUNAWAY               left by an explicit clear only
confirmed      evidence -> LOCKED, RUNAWAY
held           SENSOR, STALE                 left when good samples return
watched        SUSPECT, PROVING, SLUGGISH
healthy        OK (commanded), IDLE (not)
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.detection.states import Cause, JointState, ToolWord
from ft_manip_ros.core.detection.tracking import noise_of

OK: Final = int(JointState.OK)
IDLE: Final = int(JointState.IDLE)
SUSPECT: Final = int(JointState.SUSPECT)
LOCKED: Final = int(JointState.LOCKED)
STALE: Final = int(JointState.STALE)
SENSOR: Final = int(JointState.SENSOR)
RUNAWAY: Final = int(JointState.RUNAWAY)
PROVING: Final = int(JointState.PROVING)
SLUGGISH: Final = int(JointState.SLUGGISH)

_FOLLOWS: Final = int(Cause.FOLLOWS)
_AT_REST: Final = int(Cause.AT_REST)
_FIRST_EVIDENCE: Final = int(Cause.FIRST_EVIDENCE)
_NO_MOTION: Final = int(Cause.NO_MOTION)
_NO_MOTION_HIGH_EFFORT: Final = int(Cause.NO_MOTION_HIGH_EFFORT)
_NOT_EXECUTING: Final = int(Cause.ARM_NOT_EXECUTING)
_JUMP: Final = int(Cause.JUMP)
_VELOCITY_DISAGREES: Final = int(Cause.VELOCITY_DISAGREES)
_MOVED_WHILE_LOCKED: Final = int(Cause.MOVED_WHILE_LOCKED)
_STOPPED: Final = int(Cause.STOPPED_AMONG_MOVING)
_NO_SENSOR: Final = int(Cause.NO_SENSOR)
_CLEARED: Final = int(Cause.CLEARED)
_ENCODER_STUCK: Final = int(Cause.ENCODER_STUCK)
_TOOL_AWAITED: Final = int(Cause.TOOL_AWAITED)
_TOOL_UNCLEAR: Final = int(Cause.TOOL_UNCLEAR)
_TOOL_STANDS: Final = int(Cause.TOOL_STANDS)
_STOOD: Final = int(ToolWord.STOOD)
_UNCLEAR: Final = int(ToolWord.UNCLEAR)

LOCK_NONE: Final = 0
LOCK_FIRST: Final = 1  # first evidence
LOCK_HELD_BACK: Final = 2  # confirmed, but no commanded joint of the arm moves
LOCK_CONTRADICTED: Final = 3  # confirmed, but velocity or a jump before speak against it
LOCK_UNSENSED: Final = 4  # confirmed, but the channel never showed that it has a sensor
LOCK_CONFIRMED: Final = 5
LOCK_AWAITS_TOOL: Final = 6  # confirmed, but the tool's motion may say otherwise any moment
LOCK_ENCODER_STUCK: Final = 7  # the tool's motion shows that the joint moves

_SUSPECT_LEVEL: Final = 0.5
_CONTRADICTIONS: Final = 3
_UNCOMMANDED_CARE: Final = 5  # times the confirm window, where no command is known
_ACTIVE: Final = 0.3  # s that a joint counts as commanded after its command came to rest
_SLIP_SAMPLES: Final = 3


@kernel
def lock_stage(r: Any, s: Any, level: float) -> int:
    """How far the evidence for a lock has come, seen from this joint alone."""
    if r.exempt or level < _SUSPECT_LEVEL:
        return LOCK_NONE
    harder = 1 if r.ring_n > 0 else _UNCOMMANDED_CARE
    enough = r.still_n >= harder * s.confirm_samples
    enough = enough and r.still_time >= harder * s.confirm_s - 1e-9
    if level < 1.0 or not enough:
        return LOCK_FIRST
    if r.contradictions >= _CONTRADICTIONS or r.untrusted:
        return LOCK_CONTRADICTED
    return LOCK_CONFIRMED


@kernel
def freeze(r: Any, t: float, cause: int) -> None:
    """Become LOCKED where the joint stands."""
    r.state = LOCKED
    r.cause = cause
    r.confirmed = t
    r.first_evidence = r.suspect_since if r.suspect_since > 0.0 else t
    # Repeating samples say where it stands; otherwise an average that forgets how it got there.
    r.frozen_q = (r.q if r.repeat_run > 1 else r.late_mean) - 2.0 * np.pi * r.turns
    sigma = noise_of(r)
    # Where readings flicker, the noise holds what the steps of the encoder add.
    quantum = r.quantum if r.quantum < r.slack and r.repeat_run > 0 else 0.0
    r.frozen_sigma = np.sqrt(0.25 * sigma * sigma + quantum * quantum / 12.0 + 1e-14)
    r.slip_n = 0


@kernel
def release(r: Any) -> None:
    """End a latched fault: from here on the joint has to prove itself."""
    r.state = PROVING
    r.cause = _CLEARED
    r.proving = True
    r.manual = False
    r.frozen_q = np.nan
    r.frozen_sigma = np.nan
    r.first_evidence = 0.0
    r.confirmed = 0.0


@kernel
def watch_locked(r: Any, t: float, q: float) -> None:
    """A joint that was found LOCKED and changes its angle is not frozen: RUNAWAY."""
    q -= 2.0 * np.pi * r.turns
    if r.manual or abs(q - r.frozen_q) <= max(3.0 * r.threshold, r.prove_distance):
        r.slip_n = 0
        return
    if r.slip_n == 0:
        r.slip_since = t
    r.slip_n += 1
    if r.slip_n >= _SLIP_SAMPLES and t - r.slip_since >= 0.1:
        r.state = RUNAWAY
        r.cause = _MOVED_WHILE_LOCKED
        r.first_evidence = r.slip_since
        r.confirmed = t
        r.frozen_q = np.nan
        r.frozen_sigma = np.nan


@kernel
def decide(
    r: Any, t: float, fresh: bool, stage: int, runaway: int, stale: int, sluggish: int
) -> None:
    """Move one joint to the state that its evidence demands at time ``t`` (s).

    Parameters
    ----------
    r
        The joint's record.
    fresh
        Whether this message held an accepted sample of the joint.
    stage
        `lock_stage`, after the arm's view was added.
    runaway, stale, sluggish
        A `Cause`, or -1 for none.
    """
    if r.state == LOCKED or r.state == RUNAWAY:
        if fresh and r.state == LOCKED:
            watch_locked(r, t, r.q)
        return
    if fresh and stage == LOCK_CONFIRMED:
        freeze(r, t, _lock_cause(r))
        return
    if fresh and runaway >= 0:
        r.state = RUNAWAY
        r.cause = runaway
        r.first_evidence = r.runaway_since
        r.confirmed = t
        return
    if r.bad_run > 0:
        _enter(r, SENSOR, r.bad_cause, r.bad_since)
    elif stale >= 0:
        _enter(r, STALE, stale, t)
    elif stage == LOCK_CONTRADICTED:
        _enter(r, SENSOR, _JUMP if r.untrusted else _VELOCITY_DISAGREES, r.suspect_since)
    elif stage == LOCK_UNSENSED:
        _enter(r, SENSOR, _NO_SENSOR, r.suspect_since)
    elif stage == LOCK_ENCODER_STUCK:
        _enter(r, SENSOR, _ENCODER_STUCK, r.suspect_since)
    elif stage == LOCK_AWAITS_TOOL:
        _enter(r, SUSPECT, _TOOL_AWAITED, r.suspect_since)
    elif stage == LOCK_FIRST:
        _enter(r, SUSPECT, _FIRST_EVIDENCE, r.suspect_since)
    elif stage == LOCK_HELD_BACK:
        _enter(r, SUSPECT, _NOT_EXECUTING, r.suspect_since)
    elif r.proving:
        _enter(r, PROVING, _CLEARED, 0.0)
    elif sluggish >= 0:
        _enter(r, SLUGGISH, sluggish, t)
    elif is_active(r, t):
        _enter(r, OK, _FOLLOWS, 0.0)
    else:
        _enter(r, IDLE, _AT_REST, 0.0)


@kernel
def _lock_cause(r: Any) -> int:
    if r.ring_n == 0:
        return _STOPPED
    if r.tool_word == _UNCLEAR:
        return _TOOL_UNCLEAR
    if r.high_effort:
        return _NO_MOTION_HIGH_EFFORT
    return _TOOL_STANDS if r.tool_word == _STOOD else _NO_MOTION


@kernel
def is_active(r: Any, t: float) -> bool:
    """Tell whether the joint is commanded to move or, without commands, moves."""
    if r.ring_n > 0:
        return r.command_moves and t - r.command_rest_since < _ACTIVE + r.lag_high
    return r.has_moved and t - r.still_since < _ACTIVE


@kernel
def _enter(r: Any, state: int, cause: int, evidence: float) -> None:
    if r.state != state:
        r.state = state
        r.first_evidence = evidence
        r.confirmed = 0.0
    r.cause = cause
