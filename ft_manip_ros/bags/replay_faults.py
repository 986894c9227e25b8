"""Replay of the fault monitor: recorded joint states and commands in, changes of state out."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.bags.findings import Finding
from ft_manip_ros.bags.heard_commands import PLAN, PLANS, TRAJECTORY, recorded_commands
from ft_manip_ros.bags.joint_blocks import JointBlock
from ft_manip_ros.bags.reader import Bag, BagMessage
from ft_manip_ros.bags.replay_setup import ReplaySetup
from ft_manip_ros.core.detection.feed import MISSED, MonitorFeed
from ft_manip_ros.core.detection.monitor import FaultMonitor
from ft_manip_ros.core.detection.settings import MonitorSettings
from ft_manip_ros.core.detection.states import Edge, JointState
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.nodes.conversions import nanoseconds, trajectory_points

NODE = 'fault_monitor'
SETTINGS = {item.name for item in fields(MonitorSettings)}
# Being commanded or not, and suspicions that pass, are no faults.
_FAULTS = frozenset(JointState) - {JointState.OK, JointState.IDLE, JointState.SUSPECT}
_REQUEST_RECEIVED, _RESPONSE_SENT = 1, 2

NUMBERS = {'position': 1e-3}


class FaultReplay:
    """Feeds a fresh monitor, set up as the recorded one, with what the recorded one was fed."""

    def __init__(self, setup: ReplaySetup) -> None:
        parameters = setup.parameters(NODE)
        chain = setup.chain(NODE)
        settings = MonitorSettings(**{k: v for k, v in parameters.items() if k in SETTINGS})
        exempt = parameters.get('exempt') or []
        tool = str(parameters.get('tool_pose_topic') or '')
        self._monitor = FaultMonitor(
            chain.joints, settings, exempt=exempt, chain=chain if tool else None
        )
        self._feed = MonitorFeed(self._monitor, str(parameters.get('frame') or 'base_link'))
        self._stamp = 0
        self._seen_sample = False
        self.recorded: list[Finding] = []
        self.replayed: list[Finding] = []
        self.handlers: dict[str, Callable[[BagMessage, Any], None]] = {}
        self.block_handlers: dict[str, Callable[[JointBlock], Iterable[InputError]]] = {}
        reference = str(parameters.get('reference_topic') or '')
        for name, type_name, handler in (
            ('joint_states', 'sensor_msgs/msg/JointState', self._on_joint_state),
            (*TRAJECTORY, self._on_trajectory),
            *((name, PLAN, self._on_plan) for name in PLANS),
            (reference, 'sensor_msgs/msg/JointState', self._on_reference),
            (tool, 'geometry_msgs/msg/PoseStamped', self._on_tool_pose),
            ('fault_state', 'ft_manip_interfaces/msg/FaultState', self._on_state),
            ('fault_events', 'ft_manip_interfaces/msg/JointFault', self._on_recorded),
            (
                'fault_monitor/freeze_joint/_service_event',
                'ft_manip_interfaces/srv/FreezeJoint_Event',
                self._on_freeze,
            ),
            (
                'fault_monitor/clear_fault/_service_event',
                'ft_manip_interfaces/srv/ClearFault_Event',
                self._on_clear,
            ),
        ):
            topic = setup.topic(name, type_name) if name else None
            if topic is not None:
                self.handlers[topic] = handler
                if handler == self._on_joint_state:
                    self.block_handlers[topic] = self._on_joint_block
        self._commands = recorded_commands(setup)

    def _on_joint_block(self, block: JointBlock) -> Iterable[InputError]:
        """As `_on_joint_state` on each."""
        while (k := self._commands.before(_times(block))) < len(block.stamps):
            if k:
                self._take(block.part(slice(k)))
                block = block.part(slice(k, None))
            self._commands.deliver(self._feed)
        self._take(block)
        return ()

    def _take(self, block: JointBlock) -> None:
        self._commands.judged(int(_times(block)[-1]))
        edges = self._feed.joint_states(
            block.stamps,
            block.arrivals,
            block.names,
            block.positions,
            block.velocities,
            block.efforts,
        )
        self._stamp = int(block.stamps[-1]) or int(block.arrivals[-1])
        self._seen_sample = True
        self._note(edges)

    def _on_joint_state(self, record: BagMessage, message: Any) -> None:
        stamp = nanoseconds(message.header.stamp)
        at = stamp or record.log_time
        while not self._commands.before(np.array([at])):
            self._commands.deliver(self._feed)
        self._commands.judged(at)
        edges = self._feed.joint_state(
            stamp,
            record.log_time,
            message.name,
            message.position.tolist(),
            message.velocity.tolist(),
            message.effort.tolist(),
        )
        self._stamp = stamp or record.log_time
        self._seen_sample = True
        self._note(edges)

    def _on_trajectory(self, record: BagMessage, message: Any) -> None:
        if nanoseconds(message.header.stamp) in self._commands.starts:
            return
        self._feed.trajectory(
            nanoseconds(message.header.stamp),
            record.log_time,
            message.joint_names,
            trajectory_points(message),
        )

    def _on_plan(self, record: BagMessage, message: Any) -> None:
        if nanoseconds(message.trajectory.header.stamp) in self._commands.starts:
            return
        self._feed.planned(
            nanoseconds(message.trajectory.header.stamp),
            record.log_time,
            message.trajectory.joint_names,
            trajectory_points(message.trajectory),
        )

    def _on_reference(self, record: BagMessage, message: Any) -> None:
        self._feed.reference(
            nanoseconds(message.header.stamp), record.log_time, message.name, message.position
        )

    def _on_tool_pose(self, record: BagMessage, message: Any) -> None:
        place = message.pose.position
        self._feed.tool_pose(
            nanoseconds(message.header.stamp),
            record.log_time,
            message.header.frame_id,
            (place.x, place.y, place.z),
        )

    def _on_state(self, record: BagMessage, message: Any) -> None:
        """Take over the faults that were known before the recording began."""
        if self._seen_sample:
            return
        for joint in message.joints:
            state = _state(joint.state)
            if state in (JointState.LOCKED, JointState.RUNAWAY):
                self._monitor.restore(
                    joint.name,
                    state,
                    joint.frozen_position,
                    joint.frozen_position_sigma,
                    joint.manual,
                    joint.cause,
                )

    def _on_freeze(self, record: BagMessage, message: Any) -> None:
        if message.info.event_type == _REQUEST_RECEIVED and len(message.request):
            request = message.request[0]
            position = None if request.at_measured else request.position
            stamp = self._stamp or record.log_time
            self._note([self._monitor.freeze(request.joint, position, request.reason, stamp)])

    def _on_clear(self, record: BagMessage, message: Any) -> None:
        if message.info.event_type == _REQUEST_RECEIVED and len(message.request):
            request = message.request[0]
            stamp = self._stamp or record.log_time
            self._note(self._monitor.clear(request.joint, stamp, request.reason))

    def _on_recorded(self, record: BagMessage, message: Any) -> None:
        before, after = _state(message.previous_state), _state(message.state)
        if {before, after} & _FAULTS:
            stamp = nanoseconds(message.stamp)
            self.recorded.append(
                _finding(stamp, message.name, before, after, message.frozen_position)
            )

    def _note(self, edges: list[Edge]) -> None:
        for edge in edges:
            report = edge.report
            if {edge.previous, report.state} & _FAULTS:
                self.replayed.append(
                    _finding(
                        report.changed,
                        report.name,
                        edge.previous,
                        report.state,
                        report.frozen_position,
                    )
                )


def missed_joint_states(bag: Bag) -> int:
    """How many joint states the recorded monitor never got, by its diagnostics."""
    topic = '/diagnostics'
    counts = [
        int(pair.value)
        for message in (bag.readable((topic,)) if topic in bag.topics else ())
        for status in message.status
        if status.name == f'{NODE}: {NODE}'
        for pair in status.values
        if pair.key == MISSED and pair.value.isdecimal()
    ]
    # What was lost before the recording began is of no matter here.
    return max(counts, default=0) - min(counts, default=0)


def _times(block: JointBlock) -> NDArray[np.int64]:
    """Stamps, or arrivals of what bears none, (K,), ns."""
    return np.where(block.stamps == 0, block.arrivals, block.stamps)


def _state(number: int) -> JointState:
    try:
        return JointState(number)
    except ValueError:
        known = ', '.join(f'{state.value} {state.name}' for state in JointState)
        raise InputError('state', f'is {number}; there are {known}') from None


def _finding(
    stamp: int, joint: str, before: JointState, after: JointState, frozen: float
) -> Finding:
    # From OK, IDLE or SUSPECT is all "healthy": which of them depends on the last sample before.
    origin = before.name if before in _FAULTS else 'healthy'
    target = after.name if after in _FAULTS else 'healthy'
    values: dict[str, str | float] = {'from': origin, 'to': target}
    if after == JointState.LOCKED:
        values['position'] = float(frozen)
    return Finding('fault', stamp, joint, values)
