"""Compiled: one message after the other through every joint's evidence and state machine."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.detection.arm_view import (
    lock_stage_of,
    runaway_of,
    stale_cause,
    watch_payload,
)
from ft_manip_ros.core.detection.coasting import observe_coasting
from ft_manip_ros.core.detection.layout import NO_TIME, Memory
from ft_manip_ros.core.detection.machine import decide, lock_stage
from ft_manip_ros.core.detection.motion import QUIET, follow_proof, judge_motion
from ft_manip_ros.core.detection.plausibility import (
    NEW_POSITION,
    REPEATED_STAMP,
    judge_sample,
    note_bad,
    note_good,
    repeats_unlike_itself,
    unwrap,
)
from ft_manip_ros.core.detection.slack import fade_swallowed, learn_swallowed
from ft_manip_ros.core.detection.states import Cause, JointState
from ft_manip_ros.core.detection.stillness import (
    effort_speaks,
    learn_effort,
    lock_level,
    observe_stillness,
)
from ft_manip_ros.core.detection.tracking import learn_noise, learn_tracking, remember_command

Array = NDArray[np.float64]

_LATCHED: Final = (int(JointState.LOCKED), int(JointState.RUNAWAY))
_JUMP: Final = int(Cause.JUMP)
_DEAD: Final = int(Cause.DEAD_CHANNEL)
_LATE: Final = int(Cause.LATE)
_JERKS: Final = int(Cause.JERKS)
_GAP: Final = 1.0  # s without samples after which all windows begin anew
_BAD_RESETS: Final = 0.25  # s of bad samples after which the stillness window begins anew
_FIRST_LEVEL: Final = 0.5
_JERK_MEMORY: Final = 10.0  # s
_JERKS_MANY: Final = 4
_BACK_SAMPLES: Final = 10  # messages of a new time line before it is believed
_LATE_MARGIN: Final = 0.05  # s
_LOAD_MEMORY: Final = 300.0  # s


@kernel
def forget_windows(r: Any) -> None:
    """Start all windows of a joint anew; what was learned and decided stays."""
    r.t = NO_TIME
    r.t_1 = NO_TIME
    r.t_2 = NO_TIME
    r.has_sample = False
    r.still_n = 0
    r.ring_n = 0
    r.late_run = 0
    r.runaway_n = 0
    r.rebase_n = 0
    r.prove_q = np.nan
    r.command_moves = False
    r.command_rest_value = np.nan
    r.depart_q = np.nan
    r.command_rest_since = NO_TIME
    r.bad_run = 0
    r.past_n = 0


@kernel
def _on_time_line(memory: Memory, t: float) -> bool:
    """False while stamps lie before those already seen; True again on a new time line."""
    arm, s = memory.arm[0], memory.settings[0]
    if t > arm.now - s.time_jump_s:
        arm.back_n = 0
        if t > arm.now:
            arm.now = t
        return True
    if arm.back_n == 0 or t <= arm.back_last:
        arm.back_n = 0
        arm.back_since = t
    arm.back_n += 1
    arm.back_last = t
    if arm.back_n < _BACK_SAMPLES or t - arm.back_since < s.time_jump_s:
        return False
    for j in range(memory.joints.shape[0]):
        forget_windows(memory.joints[j])
    arm.now = t
    arm.first = t
    arm.back_n = 0
    arm.resets += 1
    return True


@kernel
def _zero_row(memory: Memory, q: Array, present: NDArray[np.bool_]) -> bool:
    """An all-zero message from an arm that stands elsewhere: the driver had nothing to say."""
    count = 0
    elsewhere = False
    for j in range(q.shape[0]):
        if present[j]:
            count += 1
            if q[j] != 0.0:
                return False
            r = memory.joints[j]
            if r.has_sample and abs(r.q) > 5.0 * r.slack:
                elsewhere = True
    return count > 1 and elsewhere


@kernel
def _accept(memory: Memory, j: int, t: float, q: float, v: float, e: float) -> int:
    """Let one believed sample speak; returns a confirmed runaway's cause or QUIET."""
    r, s, arm = memory.joints[j], memory.settings[0], memory.arm[0]
    ring_t, ring_c = memory.ring_t[j], memory.ring_c[j]
    dt = t - r.t
    if not r.has_sample or dt > _GAP:
        r.still_n = 0
        r.q_1, r.q_2 = q, q
        r.t_1, r.t_2 = NO_TIME, NO_TIME
        r.prove_q = np.nan
        dt = 0.0
    else:
        r.period_n += 1
        r.period += (dt - r.period) / min(float(r.period_n), 50.0)
    if np.isnan(r.depart_q):
        r.depart_q = q
    if observe_stillness(r, s, arm.load, ring_t, ring_c, memory.cells[j], t, q, v):
        r.has_moved = r.has_sample and dt > 0.0
        r.taken_up = r.taken_up or abs(q - r.depart_q) > r.slack
    if r.state == _LATCHED[0] or r.state == _LATCHED[1]:
        r.catch_missing = 0.0
    elif learn_swallowed(r, t, q):
        _note_jerk(r, t)
    if r.ring_n == 0:
        observe_coasting(r, memory.past_t[j], memory.past_q[j], t, q)
    r.late_mean = q if r.still_n <= 1 else r.late_mean + 0.35 * (q - r.late_mean)
    effort_speaks(r, s, e)
    level = lock_level(r)
    if level >= _FIRST_LEVEL and r.suspect_since == 0.0:
        r.suspect_since = t
    if level < 1.0:
        r.reached_since = t
    runaway = QUIET
    if r.state != _LATCHED[0] and r.state != _LATCHED[1]:
        if level < _FIRST_LEVEL and dt > 0.0:
            learn_noise(r, t, q)
            if r.runaway_n == 0:
                learn_tracking(
                    r, ring_t, ring_c, memory.lag_mean[j], memory.lag_var[j], memory.lags, t, q
                )
                learn_effort(r, e, dt)
        runaway = judge_motion(r, s, ring_t, ring_c, t, q)
        fade_swallowed(r, dt)
        arm.load = max(arm.load * (1.0 - min(dt, 1.0) / _LOAD_MEMORY), r.rest_wander)
        if r.proving:
            follow_proof(r, ring_t, ring_c, t, q)
    r.q_2, r.t_2 = r.q_1, r.t_1
    r.q_1, r.t_1 = q, t
    r.q, r.t, r.v, r.effort = q, t, v, e
    r.has_sample = True
    r.late_run = 0
    return runaway


@kernel
def _note_jerk(r: Any, t: float) -> None:
    """A suspect moved on by itself: it sticks."""
    r.jerks = r.jerks + 1 if t - r.last_jerk < _JERK_MEMORY else 1
    r.last_jerk = t
    r.suspects += 1


@kernel
def _sluggish(r: Any, t: float) -> int:
    if r.jerks >= _JERKS_MANY and t - r.last_jerk < _JERK_MEMORY:
        return _JERKS
    if r.lag_known and r.lag_low > r.lag_first + _LATE_MARGIN:
        return _LATE
    return QUIET


@kernel
def advance(
    memory: Memory,
    stamps: Array,
    q: Array,
    v: Array,
    e: Array,
    present: NDArray[np.bool_],
    commands: Array,
    live: bool,
    edges: NDArray[np.int64],
    runaways: NDArray[np.int64],
    fresh: NDArray[np.bool_],
) -> tuple[int, int]:
    """Take messages up to the first that changes a state; return how many, and how many changes.

    Parameters
    ----------
    memory
        The monitor's memory, n joints; changed in place.
    stamps : ndarray, shape (K,), s
    q, v, e : ndarray, shape (K, n)
        Positions, velocities, efforts; velocity and effort NaN where not given.
    present : ndarray of bool, shape (K, n)
        Which joints each message reports.
    commands : ndarray, shape (K, n)
        Commanded positions at the stamps; NaN where unknown.
    live
        Whether commands are streamed, so that motion beside them cannot be unseen commands.
    edges : ndarray of int, shape (n, 2)
        Written: joint and state before, for each change.
    runaways, fresh : ndarray, shape (n,)
        Scratch.
    """
    joints, arm, s = memory.joints, memory.arm[0], memory.settings[0]
    n = joints.shape[0]
    count = 0
    fresh[:] = False
    for k in range(stamps.shape[0]):
        t = stamps[k]
        if arm.now == NO_TIME:
            arm.first = t
        on_line = _on_time_line(memory, t)
        zero = _zero_row(memory, q[k], present[k])
        repeated = watch_payload(memory, t, q[k], v[k], e[k], present[k])
        arm.messages += 1
        for j in range(n):
            r = joints[j]
            runaways[j] = QUIET
            fresh[j] = False
            if on_line:
                # Also while the joint is not heard: it will have followed.
                remember_command(r, memory.ring_t[j], memory.ring_c[j], t, commands[k, j])
            if not present[k, j]:
                continue
            raw = q[k, j]
            if not on_line or t <= r.t:
                r.late_run += 1
                continue
            position = unwrap(r, raw)
            verdict = _JUMP if zero else judge_sample(r, t, position)
            if verdict == REPEATED_STAMP:
                continue
            if verdict >= 0:
                note_bad(r, t, verdict)
                if t - r.bad_since > _BAD_RESETS:
                    r.still_n = 0
                continue
            if verdict == NEW_POSITION:
                # Whether it is where it says, it has to show by following.
                r.has_sample = False
                r.proving = True
                r.untrusted = True
            r.dead = repeats_unlike_itself(r, t, raw, s.dead_s)
            note_good(r, t)
            runaways[j] = _accept(memory, j, t, position, v[k, j], e[k, j])
            fresh[j] = True
        for j in range(n):
            r = joints[j]
            before = r.state
            stage = lock_stage(r, s, lock_level(r))
            stage = lock_stage_of(memory, j, stage, fresh[j], repeated, live)
            stale = stale_cause(r, s, arm, repeated, t)
            runaway = runaway_of(memory, j, runaways[j], live)
            if r.dead and r.bad_run == 0 and stage == 0:
                # Not commanded to move, so no lock, but no angle to trust either.
                note_bad(r, t, _DEAD)
            decide(r, t, fresh[j], stage, runaway, stale, _sluggish(r, t))
            if r.state != before:
                edges[count, 0] = j
                edges[count, 1] = before
                count += 1
        if count > 0:
            return k + 1, count
    return stamps.shape[0], 0
