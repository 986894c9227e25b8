"""Replay of the re-planner: recorded tasks, joint states and faults in, plans out."""

from __future__ import annotations

import heapq
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import fields
from functools import partial
from typing import Any

import numpy as np
from std_msgs.msg import Header

from ft_manip_ros.bags.findings import Finding, Value
from ft_manip_ros.bags.joint_blocks import JointBlock
from ft_manip_ros.bags.reader import BagMessage
from ft_manip_ros.bags.replay_collision import PARAMETERS, recorded_checker
from ft_manip_ros.bags.replay_setup import ReplaySetup
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.planning.executive import Decision, Executive, ExecutiveSettings
from ft_manip_ros.core.planning.proof import needs_proof, prove
from ft_manip_ros.core.planning.settings import Order, PlanSettings, Policy, Relaxation
from ft_manip_ros.nodes.conversions import nanoseconds, seconds, task_from_message
from ft_manip_ros.nodes.conversions import stamp as stamp_of
from ft_manip_ros.nodes.plan_messages import frozen_from_message, plan_to_message

NODE = 'replanner'
_PLANNING = (
    'postures', 'attempts', 'proof_boxes', 'detour_checks', 'dwell', 'rate_scale', 'jerk_time',
    'sample_period', 'limit_weight', 'seed',
)  # fmt: skip
_WATCHING = tuple(field.name for field in fields(ExecutiveSettings))
SETTINGS = {*_PLANNING, *_WATCHING, *PARAMETERS, 'policy', 'order', 'accepted_relaxations'}
NUMBERS = {'end': 1e-3, 'duration': 1e-2, 'arrivals': 1e-2, 'frozen_at': 1e-6}
_STATUS = ('finishes', 'partial', 'halted', 'refused')
_OUTCOME = ('reachable', 'relaxed', 'lost', 'undecided')
PLAN = 'ft_manip_interfaces/msg/RecoveryPlan'
Deliver = Callable[[Any], None]


class PlanReplay:
    """Drives a fresh executive, set up as the recorded one, with the recorded messages.

    The re-planner and the recorder receive messages of different topics in slightly different
    order. A plan says with its trajectory's stamp which joint state it started from; the task or
    fault that it answers is delivered right after that one. A state that only the re-planner
    received (a recorder may join late, or lose it) is taken from the start of its trajectory.
    """

    def __init__(self, setup: ReplaySetup) -> None:
        self.recorded: list[Finding] = []
        self.replayed: list[Finding] = []
        self.handlers: dict[str, Callable[[BagMessage, Any], None]] = {}
        self.block_handlers: dict[str, Callable[[JointBlock], Iterable[InputError]]] = {}
        # For the stamp of each message that plans answer: where those plans start, in order.
        self._starts: dict[int, deque[int]] = defaultdict(deque)
        # What plans tell of the states they start from: positions and speeds by stamp.
        self._told: dict[int, tuple[dict[str, float], dict[str, float] | None]] = {}
        self._due: list[tuple[int, int, Callable[[], None]]] = []
        self._scheduled: set[tuple[str, int]] = set()
        # Stamp of the last one delivered of each topic.
        self._delivered: dict[str, int] = {}
        self._latest = 0
        plans = [setup.topic('recovery_plan', PLAN), setup.topic('replanner/task_plan', PLAN)]
        if not any(plans):
            return
        planning, watching = _settings(setup.parameters(NODE))
        self._planning = planning
        chain = setup.chain(NODE)
        checker = recorded_checker(setup, NODE, chain)
        self._executive = Executive(chain, planning, watching, checker)
        self._read_plans(setup, [topic for topic in plans if topic is not None])
        for name, type_name, deliver in (
            ('task', 'ft_manip_interfaces/msg/Task', self._deliver_task),
            ('fault_state', 'ft_manip_interfaces/msg/FaultState', self._deliver_fault),
        ):
            topic = setup.topic(name, type_name)
            if topic is not None:
                self.handlers[topic] = partial(self._on_trigger, deliver)
                self._schedule(setup, topic, deliver)
        states = setup.topic('joint_states', 'sensor_msgs/msg/JointState')
        if states is not None:
            self.handlers[states] = self._on_joint_state
            self.block_handlers[states] = self._on_joint_block

    def _read_plans(self, setup: ReplaySetup, topics: list[str]) -> None:
        for message in setup.bag.readable(topics):
            self.recorded.append(_finding(message))
            start = nanoseconds(message.trajectory.header.stamp)
            if start:
                self._starts[nanoseconds(message.header.stamp)].append(start)
                if len(message.trajectory.points):
                    self._told[start] = _start_state(message.trajectory)

    def _schedule(self, setup: ReplaySetup, topic: str, deliver: Deliver) -> None:
        """Deliver each message that a plan answers right after the state it starts from."""
        for message in setup.bag.readable([topic]):
            stamp = nanoseconds(message.header.stamp)
            if self._starts.get(stamp) and (topic, stamp) not in self._scheduled:
                self._scheduled.add((topic, stamp))
                start = self._starts[stamp].popleft()
                self._at(start, partial(self._deliver, topic, deliver, message))

    def _at(self, state: int, action: Callable[[], None]) -> None:
        heapq.heappush(self._due, (state, len(self._due), action))

    def _on_joint_state(self, record: BagMessage, message: Any) -> None:
        stamp = nanoseconds(message.header.stamp)
        names = list(message.name)
        if len(message.position) != len(names):
            raise InputError('joint state: position', f'has {len(message.position)} values')
        velocities = None
        if len(message.velocity) == len(names):
            velocities = dict(zip(names, message.velocity.tolist(), strict=True))
        positions = dict(zip(names, message.position.tolist(), strict=True))
        self._take(stamp, positions, velocities)

    def _on_joint_block(self, block: JointBlock) -> Iterator[InputError]:
        """As `_on_joint_state` on each; yields what was refused."""
        names, m = block.names, len(block.names)
        speeds = block.velocities.tolist() if block.velocities.shape[1] == m else None
        rows = block.positions.tolist()
        for k, stamp in enumerate(block.stamps.tolist()):
            try:
                if len(rows[k]) != m:
                    raise InputError('joint state: position', f'has {len(rows[k])} values')
                velocities = None if speeds is None else dict(zip(names, speeds[k], strict=True))
                self._take(stamp, dict(zip(names, rows[k], strict=True)), velocities)
            except InputError as error:
                yield error

    def _take(
        self, stamp: int, positions: dict[str, float], velocities: dict[str, float] | None
    ) -> None:
        while self._due and self._latest < (start := self._due[0][0]) < stamp:
            if start not in self._told:
                break
            # One that does not fit this arm is left out; then the next state has to do.
            with suppress(InputError):
                self._take(start, *self._told.pop(start))
        _, decision = self._executive.on_joint_state(stamp, positions, velocities)
        self._latest = max(self._latest, stamp)
        self._note(decision, stamp)
        while self._due and self._due[0][0] <= self._latest:
            heapq.heappop(self._due)[2]()

    def _on_trigger(self, deliver: Deliver, record: BagMessage, message: Any) -> None:
        stamp = nanoseconds(message.header.stamp)
        # The re-planner heard of one message of a topic after the other: of one that was recorded
        # behind the state that a later one was delivered with, before that.
        superseded = stamp < self._delivered.get(record.topic, stamp)
        if (record.topic, stamp) not in self._scheduled and not superseded:
            self._deliver(record.topic, deliver, message)

    def _deliver(self, topic: str, deliver: Deliver, message: Any) -> None:
        self._delivered[topic] = nanoseconds(message.header.stamp)
        deliver(message)

    def _deliver_task(self, message: Any) -> None:
        decision = self._executive.on_task(task_from_message(message))
        self._note(decision, nanoseconds(message.header.stamp))

    def _deliver_fault(self, message: Any) -> None:
        stamp = nanoseconds(message.header.stamp)
        decision = self._executive.on_fault_state(stamp, *frozen_from_message(message))
        self._note(decision, stamp)

    def _note(self, decision: Decision | None, header: int) -> None:
        if decision is None:
            return
        message = plan_to_message(
            decision.plan, '', Header(stamp=stamp_of(header)), decision.stamp
        )
        self.replayed.append(_finding(message))
        if needs_proof(decision.plan) and not decision.restated:
            proof = prove(self._executive.chain, decision.plan, self._planning)

            def deliver() -> None:
                self._note(self._executive.on_proof(decision, proof), header)

            # The node's proof arrived when its plan says; a report alone hangs on no state.
            starts = self._starts.get(header)
            self._at(starts.popleft() if starts else decision.stamp, deliver)


def _start_state(trajectory: Any) -> tuple[dict[str, float], dict[str, float] | None]:
    """Positions and speeds by joint at the start of a trajectory message with a stamp."""
    names, first = list(trajectory.joint_names), trajectory.points[0]
    positions = dict(zip(names, first.positions.tolist(), strict=False))
    if len(first.velocities) != len(names):
        return positions, None
    return positions, dict(zip(names, first.velocities.tolist(), strict=True))


def _settings(parameters: dict[str, Any]) -> tuple[PlanSettings, ExecutiveSettings]:
    planning = {key: parameters[key] for key in _PLANNING if key in parameters}
    if 'policy' in parameters:
        planning['policy'] = _member(Policy, 'policy', parameters['policy'])
    if 'order' in parameters:
        planning['order'] = _member(Order, 'order', parameters['order'])
    if parameters.get('accepted_relaxations'):
        planning['accepted'] = frozenset(
            _member(Relaxation, 'accepted_relaxations', name)
            for name in parameters['accepted_relaxations']
        )
    watching = {key: parameters[key] for key in _WATCHING if key in parameters}
    return PlanSettings(**planning), ExecutiveSettings(**watching)


def _member(kind: Any, name: str, value: Any) -> Any:
    try:
        return kind(value)
    except ValueError:
        raise InputError(
            f'parameter {name}', f'is {value!r}; valid are {", ".join(m.value for m in kind)}'
        ) from None


def _finding(message: Any) -> Finding:
    points = message.trajectory.points
    outcomes = [f'{g.index}={_name(_OUTCOME, g.outcome)}{g.relaxation}' for g in message.goals]
    # Planning takes no time in a replay. Bags of before have no such field.
    pause = float(getattr(message, 'pause', 0.0))
    arrivals = [float(goal.arrival) - pause for goal in message.goals]
    values: dict[str, Value] = {
        'status': _name(_STATUS, message.status),
        'goals': ' '.join(outcomes),
    }
    details: dict[str, Value] = {
        'arrivals': tuple(np.nan_to_num(arrivals, nan=-1.0).tolist()),
        'frozen_at': tuple(float(p) for p in message.frozen_positions),
        'end': tuple(float(p) for p in points[-1].positions) if len(points) else (),
        'duration': seconds(points[-1].time_from_start) - pause if len(points) else 0.0,
    }
    # The state that a plan starts from is the same for both; when they heard of it is not.
    when = nanoseconds(message.trajectory.header.stamp) or nanoseconds(message.header.stamp)
    frozen = ', '.join(message.frozen_joints) or 'no joint'
    return Finding('plan', when, f'plan with {frozen} frozen', values, details)


def _name(names: tuple[str, ...], number: int) -> str:
    return names[number] if 0 <= number < len(names) else str(number)
