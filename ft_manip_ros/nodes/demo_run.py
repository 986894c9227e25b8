"""One run of the demo: the task is executed, a joint locks, the arm finishes with the rest."""

from __future__ import annotations

import contextlib
from functools import partial

import numpy as np

from ft_manip_interfaces.msg import GoalReport, JointFault, RecoveryPlan
from ft_manip_interfaces.srv import InjectFault
from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.goal import Task
from ft_manip_ros.core.joint_path import JointPath
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.conversions import (
    nanoseconds,
    path_from_message,
    task_to_message,
)
from ft_manip_ros.nodes.demo_observer import Observer, SilenceError, StoryError
from ft_manip_ros.nodes.demo_record import Point, Record
from ft_manip_ros.nodes.demo_timeline import Timeline

FRAME = 'base_link'
# A joint can only be seen to be locked where it still has to move (rad or m).
_LEAST_WAY = 0.15
# Time for the service call that arranges the failure, and for the monitor to see the arm (s).
_LEAD = 0.4
_SECOND = 1_000_000_000
# After the last planned motion; the re-planner goes again to what was missed within half of it.
_SETTLING = 1.0  # s
_PROOF_TIME = 5.0  # s
_ATTEMPTS = 3
_FATES = {
    GoalReport.REACHABLE: 'reachable',
    GoalReport.RELAXED: 'relaxed',
    GoalReport.LOST: 'lost',
    GoalReport.UNDECIDED: 'undecided',
}
_STATUSES = {
    RecoveryPlan.FINISHES: 'finishes',
    RecoveryPlan.PARTIAL: 'partial',
    RecoveryPlan.HALTED: 'halted',
    RecoveryPlan.REFUSED: 'refused',
}


class NotNeededError(StoryError):
    """The task does not move the joint: its failure could not be noticed, and costs nothing."""


def start_posture(chain: SerialChain, rng: np.random.Generator) -> Array:
    """Where the arm stands before the task, shape (n,): anywhere, but away from its limits."""
    middle = 0.5 * (chain.operating_lower + chain.operating_upper)
    half = 0.5 * (chain.operating_upper - chain.operating_lower)
    return middle + 0.5 * half * rng.uniform(-1.0, 1.0, chain.n)


def choose_failure(
    path: JointPath, joints: list[str], latest: float, rng: np.random.Generator
) -> tuple[str, float]:
    """Choose which joint locks and when (s from the start of the motion).

    Parameters
    ----------
    joints
        Candidates; one of them is drawn.
    latest
        When the last goal is reached (s): a joint has to have some way to go until then, or
        nobody, the task least of all, could notice.

    Raises
    ------
    NotNeededError
        If no candidate has to move that far.
    """
    times = np.arange(0.0, latest, 0.01)
    q = np.array([path.sample(float(t))[0] for t in times])
    ahead = np.cumsum(np.abs(np.diff(q, axis=0))[::-1], axis=0)[::-1]
    for joint in rng.permutation(joints):
        column = path.joint_names.index(str(joint))
        moments = times[:-1][(ahead[:, column] >= _LEAST_WAY) & (times[:-1] >= _LEAD)]
        if len(moments):
            return str(joint), float(rng.choice(moments))
    raise NotNeededError(
        f'the task does not move {", ".join(joints)} by {_LEAST_WAY} after its start: a lock '
        'could not be noticed, and would cost nothing'
    )


def execute(
    chain: SerialChain,
    task: Task,
    joints: list[str],
    fault_tolerant: bool,
    rng: np.random.Generator,
    observer: Observer,
    timeline: Timeline,
) -> Record:
    """Run the task, lock a joint, and watch what the nodes make of it.

    Raises
    ------
    StoryError
        If something does not happen at all; what happens wrongly is in the record's problems.
    """
    start, path, plan = _begin(chain, task, observer, timeline)
    arrivals = [goal.arrival for goal in plan.goals if np.isfinite(goal.arrival)]
    if not arrivals:
        raise StoryError(f'the healthy arm cannot start the task: {plan.reason}')
    joint, moment = choose_failure(path, joints, max(arrivals), rng)
    record = Record(chain, task, joint, fault_tolerant, started=start)
    timeline.line('replanner', f'the arm moves: {plan.reason}, {path.duration:.1f} s')
    _lock(record, start + round(moment * _SECOND), observer)
    timeline.line('arm_sim', f'{joint} LOCKS {moment:.2f} s into the motion (nobody is told)')
    _watch(record, observer, timeline)
    _measure(record, observer)
    return record


def _begin(
    chain: SerialChain, task: Task, observer: Observer, timeline: Timeline
) -> tuple[int, JointPath, RecoveryPlan]:
    """Publish the task until arm and monitor both know the motion: start, path and plan of it.

    A trajectory is lost on a listener that its sender has not discovered yet, and only the
    listener can tell: the monitor names the command it knows with every state.
    """
    for attempt in range(1, _ATTEMPTS + 1):
        sent = observer.now()
        observer.publish_task(task_to_message(task, sent, FRAME))
        timeline.line('demo', f'task {task.name} published, {len(task.goals)} points')
        observer.until(partial(_has_plans, observer, attempt), 20.0, 'a plan')
        plan = observer.task_plans[-1][1]
        if not plan.trajectory.points:
            raise StoryError(f'the healthy arm cannot start the task: {plan.reason}')
        with contextlib.suppress(SilenceError):
            observer.until(partial(_is_followed, observer, sent), 2.0, 'the motion')
            path = path_from_message(plan.trajectory, chain.joint_names)
            return nanoseconds(plan.trajectory.header.stamp), path, plan
    raise StoryError('the fault monitor does not hear what the arm is commanded to do')


def _has_plans(observer: Observer, count: int) -> bool:
    return len(observer.task_plans) >= count


def _is_followed(observer: Observer, since: int) -> bool:
    """Whether the monitor has seen a joint follow a command that it knows."""
    return any(
        joint.state == JointFault.OK and np.isfinite(joint.commanded_position)
        for heard, message in observer.faults
        if heard > since
        for joint in message.joints
    )


def _lock(record: Record, at: int, observer: Observer) -> None:
    request = InjectFault.Request(joint=record.joint, kind=InjectFault.Request.LOCK)
    request.delay = max((at - observer.now()) * 1e-9, 0.0)
    answer = observer.call(InjectFault, topics.INJECT_FAULT, request, timeout=5.0)
    if not answer.success:
        raise StoryError(f'the simulated arm refused the failure: {answer.message}')
    record.locked_at = nanoseconds(answer.stamp)
    observer.until(lambda: observer.now() >= record.locked_at, 60.0, 'the failure')


def _watch(record: Record, observer: Observer, timeline: Timeline) -> None:
    """Wait for the fault, for the plan, and for the end of the motion."""
    joint = record.joint
    heard, state = observer.until(
        lambda: next(((t, m) for t, m in observer.faults if joint in m.frozen_joints), None),
        15.0,
        f'the fault monitor to notice that {joint} is locked',
    )
    fault = next(item for item in state.joints if item.name == joint)
    record.detected_heard, record.detected_stamp = heard, nanoseconds(fault.confirmed)
    record.detected_position = fault.frozen_position
    record.detected_sigma, record.cause = fault.frozen_position_sigma, fault.cause
    timeline.line('fault_monitor', f'{joint} is LOCKED at {fault.frozen_position:+.4f}', good=True)
    heard, plan = observer.until(
        lambda: next(((t, m) for t, m in observer.plans if joint in m.frozen_joints), None),
        15.0,
        'a plan for the arm with the locked joint',
    )
    record.plan_heard, record.compute_time = heard, plan.compute_time
    record.plan_status, record.plan_reason = _STATUSES[plan.status], plan.reason
    timeline.line('replanner', f'{record.plan_status}: {plan.reason}')
    observer.until(lambda: _finished(observer), 120.0, 'the end of the motion')
    if not _decided(observer):
        # Proofs that a point is lost are worked out after the plan has left.
        with contextlib.suppress(SilenceError):
            observer.until(lambda: _decided(observer), _PROOF_TIME, 'proofs')


def _finished(observer: Observer) -> bool:
    """Whether the newest motion is over and the arm has settled."""
    end = observer.plans[-1][0]
    if observer.trajectories:
        heard, message = observer.trajectories[-1]
        start = nanoseconds(message.header.stamp) or heard
        end = max(end, start + nanoseconds(message.points[-1].time_from_start))
    settled = end + round(_SETTLING * _SECOND)
    return bool(observer.states) and nanoseconds(observer.states[-1].header.stamp) >= settled


def _decided(observer: Observer) -> bool:
    """Whether the newest report leaves no goal undecided."""
    return all(goal.outcome != GoalReport.UNDECIDED for goal in observer.plans[-1][1].goals)


def _measure(record: Record, observer: Observer) -> None:
    """Fill in the record what was measured and commanded."""
    chain = record.chain
    states = [m for m in observer.states if set(chain.joint_names) <= set(m.name)]
    states.sort(key=lambda m: nanoseconds(m.header.stamp))
    record.stamps = np.array([nanoseconds(m.header.stamp) for m in states])
    record.positions = np.array(
        [chain.vector(dict(zip(m.name, m.position, strict=True))) for m in states]
    )
    record.commands = [
        (start, path) for start, path in _commands(observer, chain) if start >= record.started
    ]
    stands = record.positions[record.stamps > record.locked_at + _SECOND // 10]
    record.frozen_truth = float(np.median(stands[:, chain.index(record.joint)]))
    record.falsely_locked = tuple(
        sorted(
            {
                item.name
                for _, message in observer.faults
                for item in message.joints
                if item.state == JointFault.LOCKED and item.name != record.joint
            }
        )
    )
    first = next(m for _, m in observer.plans if record.joint in m.frozen_joints)
    last = observer.plans[-1][1]
    reports = {goal.index: goal for goal in (*first.goals, *last.goals)}
    distances = record.distances()
    for index, goal in enumerate(record.task.goals):
        report = reports.get(index)
        when = record.stamps > record.locked_at if report else record.stamps <= record.plan_heard
        rows = np.flatnonzero(when)
        nearest = rows[int(np.argmin(distances[rows, index]))]
        record.points.append(
            Point(
                goal.id or f'point {index + 1}',
                goal.position,
                _FATES[report.outcome] if report else 'reached before',
                report.reason if report else '',
                float(distances[nearest, index]),
                int(record.stamps[nearest]),
            )
        )


def _commands(observer: Observer, chain: SerialChain) -> list[tuple[int, JointPath]]:
    return [
        (nanoseconds(m.header.stamp) or heard, path_from_message(m, chain.joint_names))
        for heard, m in observer.trajectories
    ]
