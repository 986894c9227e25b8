"""What a report shows, taken from a bag: joints, commands, faults, plans, verdicts, tool path."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ft_manip_ros.bags.reader import Bag, BagMessage
from ft_manip_ros.bags.replay_setup import ReplaySetup
from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.nodes.conversions import nanoseconds, seconds

STATES = (
    'OK', 'IDLE', 'SUSPECT', 'LOCKED', 'STALE', 'SENSOR', 'RUNAWAY', 'PROVING', 'SLUGGISH',
)  # fmt: skip
STATUSES = ('finishes', 'partial', 'halted', 'refused')
OUTCOMES = ('reachable', 'relaxed', 'lost', 'undecided')
VERDICTS = ('member', 'non_member', 'undecided')
_RESPONSE_SENT = 2
_MICRO = 1e-9
# A joint's reading or command (rad or m) that no picture can show.
_ABSURD = 1e6


@dataclass(frozen=True)
class Event:
    """One line of the timeline; ``time`` in s from the start of the bag."""

    time: float
    who: str
    text: str
    bad: bool = False


@dataclass
class ReportData:
    """Times are in s from the first message.

    Attributes
    ----------
    joints
        Times (K,) and positions (K,) by joint.
    commands
        Times and positions of commanded points by joint, one pair for each trajectory.
    locks
        (time, joint, frozen position) of LOCKED joints.
    goals
        (id, position (3,)) of the task.
    tool
        Times (K,) and tool positions (K, 3), where the arm is known.
    """

    bag: Bag
    events: list[Event] = field(default_factory=list)
    joints: dict[str, tuple[Array, Array]] = field(default_factory=dict)
    commands: dict[str, list[tuple[Array, Array]]] = field(default_factory=dict)
    locks: list[tuple[float, str, float]] = field(default_factory=list)
    goals: list[tuple[str, Array]] = field(default_factory=list)
    plans: list[tuple[float, Any]] = field(default_factory=list)
    answers: list[tuple[float, Any]] = field(default_factory=list)
    tool: tuple[Array, Array] | None = None
    notes: list[str] = field(default_factory=list)


def collect(bag: Bag, arm: str = '') -> ReportData:
    """Read a bag for a report; what is missing or unreadable is noted and left out.

    Raises
    ------
    InputError
        If the bag has no messages.
    """
    if bag.message_count == 0:
        raise InputError(f'bag {bag.path}', 'has no messages to report on')
    data = ReportData(bag, notes=list(bag.notes))
    samples: list[tuple[float, dict[str, float]]] = []
    absurd: set[str] = set()
    for record, message in _decoded(bag, data):
        time = (record.log_time - bag.start) * _MICRO
        kind = record.type_name.rsplit('/', 1)[-1]
        if kind == 'JointState' and record.topic.endswith('joint_states'):
            stamp = nanoseconds(message.header.stamp) or record.log_time
            at = (stamp - bag.start) * _MICRO
            values = dict(zip(message.name, message.position.tolist(), strict=False))
            absurd |= {name for name, value in values.items() if abs(value) > _ABSURD}
            samples.append((at, {n: v for n, v in values.items() if not abs(v) > _ABSURD}))
        elif kind == 'JointTrajectory':
            _take_trajectory(data, message, record)
        elif kind == 'Task':
            data.goals = [(g.id, _point(g.pose.position)) for g in message.goals]
            data.events.append(Event(time, 'task', f'{message.name}: {len(message.goals)} goals'))
        elif kind == 'JointFault':
            _take_fault(data, message)
        elif kind == 'RecoveryPlan':
            _take_plan(data, time, message)
        elif kind == 'QueryFtws_Event' and message.info.event_type == _RESPONSE_SENT:
            _take_answers(data, time, message)
        elif kind == 'DesignCandidate' and record.topic.endswith('design/final'):
            data.events.append(Event(time, 'designer', message.reason))
        elif kind == 'InjectFault_Event' and message.info.event_type == _RESPONSE_SENT:
            text = message.response[0].message if len(message.response) else ''
            data.events.append(Event(time, 'arm_sim', f'failure injected: {text}'))
    for name in dict.fromkeys(name for _, values in samples for name in values):
        rows = [(at, values[name]) for at, values in samples if name in values]
        data.joints[name] = (np.array([r[0] for r in rows]), np.array([r[1] for r in rows]))
    if absurd:
        names = ', '.join(sorted(absurd))
        data.notes.append(f'left out of the pictures: readings beyond {_ABSURD:g} of {names}')
    data.events.sort(key=lambda event: event.time)
    _follow_tool(data, samples, arm)
    return data


def _decoded(bag: Bag, data: ReportData) -> Iterator[tuple[BagMessage, Any]]:
    kinds = ('JointState', 'JointTrajectory', 'Task', 'JointFault', 'RecoveryPlan',
             'QueryFtws_Event', 'DesignCandidate', 'InjectFault_Event')  # fmt: skip
    wanted = {t for t, i in bag.topics.items() if i.type_name.rsplit('/', 1)[-1] in kinds}
    refused = 0
    for record in bag.messages(wanted):
        try:
            yield record, bag.decode_expected(record)
        except InputError as error:
            refused += 1
            if refused == 1:
                data.notes.append(str(error))
    if refused > 1:
        data.notes.append(f'{refused} messages are not readable')


def _take_trajectory(data: ReportData, message: Any, record: BagMessage) -> None:
    start = nanoseconds(message.header.stamp) or record.log_time
    times = np.array([seconds(p.time_from_start) for p in message.points])
    times = times + (start - data.bag.start) * _MICRO
    for k, name in enumerate(message.joint_names):
        values = [p.positions[k] if k < len(p.positions) else np.nan for p in message.points]
        shown = np.where(np.abs(values) > _ABSURD, np.nan, values)
        data.commands.setdefault(name, []).append((times, shown))


def _take_fault(data: ReportData, message: Any) -> None:
    time = (nanoseconds(message.stamp) - data.bag.start) * _MICRO
    state = _name(STATES, message.state)
    if state in ('OK', 'IDLE', 'SUSPECT') and message.previous_state in (0, 1, 2):
        return
    where = f' at {message.frozen_position:.4f}' if state == 'LOCKED' else ''
    text = f'{message.name} {state}{where}: {message.cause}'
    bad = state in ('LOCKED', 'RUNAWAY', 'SENSOR', 'STALE')
    data.events.append(Event(time, 'fault_monitor', text, bad))
    if state == 'LOCKED' and abs(message.frozen_position) <= _ABSURD:
        data.locks.append((time, message.name, float(message.frozen_position)))


def _take_plan(data: ReportData, time: float, message: Any) -> None:
    data.plans.append((time, message))
    frozen = ', '.join(message.frozen_joints) or 'nothing'
    status = _name(STATUSES, message.status)
    text = f'plan with {frozen} frozen: {status}: {message.reason}'
    data.events.append(Event(time, 'replanner', text, status != 'finishes'))


def _take_answers(data: ReportData, time: float, message: Any) -> None:
    for response in message.response:
        data.answers += [(time, answer) for answer in response.answers]
        counts = [_name(VERDICTS, answer.verdict) for answer in response.answers]
        text = ', '.join(f'{counts.count(v)} {v}' for v in VERDICTS if v in counts)
        data.events.append(Event(time, 'workspace', f'{len(counts)} points judged: {text}'))


def _follow_tool(
    data: ReportData, samples: list[tuple[float, dict[str, float]]], arm: str
) -> None:
    try:
        chain = _chain(data.bag, arm)
    except InputError as error:
        data.notes.append(f'no tool path: {error}')
        return
    whole = [(at, v) for at, v in samples if all(n in v for n in chain.joint_names)]
    if whole:
        q = np.array([[values[n] for n in chain.joint_names] for _, values in whole])
        good = np.isfinite(q).all(axis=1)
        times = np.array([at for at, _ in whole])[good]
        data.tool = (times, fk(chain, q[good])[1]) if good.any() else None


def _chain(bag: Bag, arm: str) -> SerialChain:
    setup = ReplaySetup(bag, arm=arm)
    for node in ('replanner', 'fault_monitor', 'arm_sim', 'workspace'):
        if any(name.startswith('arm/') and node in name for name in bag.attachments):
            return setup.chain(node)
    return setup.chain('replanner')


def _point(point: Any) -> Array:
    return np.array([point.x, point.y, point.z])


def _name(names: tuple[str, ...], number: int) -> str:
    return names[number] if 0 <= number < len(names) else str(number)
