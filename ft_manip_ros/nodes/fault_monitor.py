"""Node `fault_monitor`: joint states and commanded motion in, faults of the joints out."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped
from rclpy.clock import JumpThreshold, TimeJump
from rclpy.duration import Duration
from sensor_msgs.msg import JointState as JointStateMessage
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from ft_manip_interfaces.msg import CommandHeard, FaultState, JointFault, RecoveryPlan
from ft_manip_interfaces.srv import ClearFault, FreezeJoint
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.detection.feed import MISSED, MonitorFeed
from ft_manip_ros.core.detection.mimics import MimicWatch, mimics_of
from ft_manip_ros.core.detection.monitor import FaultMonitor
from ft_manip_ros.core.detection.settings import MonitorSettings
from ft_manip_ros.core.detection.state_file import restore_faults, save_faults
from ft_manip_ros.core.detection.states import LATCHED, Edge, JointState
from ft_manip_ros.core.detection.warm_up import warm_up
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.arm_model import arm_source
from ft_manip_ros.nodes.conversions import (
    nanoseconds,
    position_from_message,
    stamp,
    trajectory_points,
)
from ft_manip_ros.nodes.fault_messages import (
    NODE,
    desired_positions,
    diagnostics_message,
    fault_markers,
    fault_message,
    state_message,
)
from ft_manip_ros.nodes.fault_parameters import PARAMETERS
from ft_manip_ros.nodes.loss_count import LossCount
from ft_manip_ros.nodes.managed_node import ManagedNode
from ft_manip_ros.nodes.process import run

_SILENT = 1_000_000_000  # ns without any joint state after which diagnostics say so
_BLIND = (
    'no commanded motion seen: only stale samples, sensor faults and joints that stop dead '
    'while others move can be told'
)


class FaultMonitorNode(ManagedNode):
    """Feeds the monitor and publishes what it finds."""

    def __init__(self) -> None:
        super().__init__(NODE, PARAMETERS)

    def configure(self) -> None:
        """Load the arm and the faults of an earlier run, open the topics."""
        source = arm_source(self)
        self._chain = load_arm(
            source, base=self.param('base') or None, tip=self.param('tip') or None
        )
        settings = MonitorSettings(
            **{item.name: self.param(item.name) for item in fields(MonitorSettings)}
        )
        tool = self.param('tool_pose_topic')
        self._frame = self.param('frame')
        self._monitor = FaultMonitor(
            self._chain.joints,
            settings,
            exempt=self.param('exempt'),
            chain=self._chain if tool else None,
        )
        self._feed = MonitorFeed(self._monitor, self._frame)
        self._mimics = MimicWatch(mimics_of(source, self._monitor.names), settings)
        self._sequence = 0
        self._stamp = 0
        self._arrival: int | None = None
        self._commanded = False
        self._told: set[str] = set()
        path = self.param('state_file')
        self._file = Path(path).expanduser() if path else None
        if self._file and not self.param('forget'):
            for name in restore_faults(self._file, self._monitor):
                self.get_logger().warning(f'{name} is still faulty, by {self._file}')
        self._states = self.advertise(FaultState, topics.FAULT_STATE, topics.LATCHED_QOS)
        self._events = self.advertise(JointFault, topics.FAULT_EVENTS, topics.EVENT_QOS)
        self._heard = self.advertise(CommandHeard, topics.COMMANDS_HEARD, topics.TRAJECTORY_QOS)
        self._markers = self.advertise(MarkerArray, topics.markers(NODE), topics.LATCHED_QOS)
        # Diagnostics tell of an inactive monitor, too: an ordinary publisher.
        self._diagnostics = self.create_publisher(
            DiagnosticArray, topics.DIAGNOSTICS, topics.COMMAND_QOS
        )
        self._losses = LossCount()
        self.subscribe(
            JointStateMessage,
            topics.JOINT_STATES,
            self._on_joint_state,
            topics.EVIDENCE_QOS,
            timed=True,
            losses=self._losses,
        )
        self.subscribe(
            JointTrajectory,
            topics.JOINT_TRAJECTORY,
            self._on_trajectory,
            topics.COMMAND_QOS,
            timed=True,
        )
        # A trajectory is lost on a listener that its sender has not discovered; these are kept.
        for report in (topics.TASK_PLAN, topics.RECOVERY_PLAN):
            self.subscribe(RecoveryPlan, report, self._on_plan, topics.LATCHED_QOS, timed=True)
        if self.param('reference_topic'):
            self.subscribe(
                JointStateMessage,
                self.param('reference_topic'),
                self._on_reference,
                topics.EVIDENCE_QOS,
                timed=True,
            )
        if tool:
            self.subscribe(PoseStamped, tool, self._on_tool_pose, topics.EVIDENCE_QOS, timed=True)
        self._subscribe_controller_state(self.param('controller_state_topic'))
        self.serve(FreezeJoint, topics.FREEZE_JOINT, self._on_freeze)
        self.serve(ClearFault, topics.CLEAR_FAULT, self._on_clear)
        self.create_timer(1.0, self._on_diagnostics)
        self._jump = self.get_clock().create_jump_callback(
            JumpThreshold(
                min_forward=Duration(seconds=10.0),
                min_backward=Duration(seconds=-1e-3),
                on_clock_change=True,
            ),
            post_callback=self._on_time_jump,
        )

    def warm_up(self) -> None:
        """Compile what every message will need."""
        warm_up(self._chain if self._monitor.tool is not None else None)

    def activate(self) -> None:
        """Say what is known, which may be faults of an earlier run."""
        self._publish_state(self._stamp or self._now())

    def release(self) -> None:
        """Stop listening to the clock."""
        jump = getattr(self, '_jump', None)
        if jump is not None:
            jump.unregister()
            self._jump = None

    def _subscribe_controller_state(self, topic: str) -> None:
        if not topic:
            return
        try:
            messages = import_module('control_msgs.msg')
        except ImportError:
            return
        self.subscribe(
            messages.JointTrajectoryControllerState,
            topic,
            self._on_controller_state,
            topics.EVIDENCE_QOS,
            timed=True,
        )

    def _now(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _on_joint_state(self, message: JointStateMessage, arrival: int) -> None:
        edges = self._feed.joint_state(
            nanoseconds(message.header.stamp),
            arrival,
            message.name,
            message.position,
            message.velocity,
            message.effort,
        )
        if self._mimics.mimics:
            self._mimics.sample(
                nanoseconds(message.header.stamp) or arrival,
                # Of the right length, or empty: the feed has looked.
                dict(zip(message.name, message.position, strict=False)),
            )
        self._arrival = arrival
        self._stamp = nanoseconds(message.header.stamp) or arrival
        foreign = self._feed.ignored - self._told - self._mimics.names
        if foreign:
            self._told |= foreign
            self.get_logger().info(
                f'not joints of this arm, ignored: {", ".join(sorted(foreign))}'
            )
        if edges:
            self._tell(edges, self._stamp)

    def _on_trajectory(self, message: JointTrajectory, arrival: int) -> None:
        start = nanoseconds(message.header.stamp)
        taken = self._feed.trajectory(
            start, arrival, message.joint_names, trajectory_points(message)
        )
        self._commanded = True
        if taken:
            self._tell_command(start)

    def _on_plan(self, message: RecoveryPlan, arrival: int) -> None:
        start = nanoseconds(message.trajectory.header.stamp)
        if self._feed.planned(
            start,
            arrival,
            message.trajectory.joint_names,
            trajectory_points(message.trajectory),
        ):
            self._commanded = True
            self._tell_command(start)

    def _tell_command(self, start: int) -> None:
        # One without a stamp cannot be named; it is replayed where it was recorded.
        if start:
            self._heard.publish(CommandHeard(start=stamp(start), after=stamp(self._feed.latest)))

    def _on_reference(self, message: JointStateMessage, arrival: int) -> None:
        self._feed.reference(
            nanoseconds(message.header.stamp), arrival, message.name, message.position
        )
        self._commanded = True

    def _on_tool_pose(self, message: PoseStamped, arrival: int) -> None:
        self._feed.tool_pose(
            nanoseconds(message.header.stamp),
            arrival,
            message.header.frame_id,
            position_from_message(message.pose.position).tolist(),
        )

    def _on_controller_state(self, message: Any, arrival: int) -> None:
        self._feed.reference(
            nanoseconds(message.header.stamp),
            arrival,
            message.joint_names,
            desired_positions(message),
        )
        self._commanded = True

    def _on_freeze(
        self, request: FreezeJoint.Request, response: FreezeJoint.Response
    ) -> FreezeJoint.Response:
        edge = self._monitor.freeze(
            request.joint,
            None if request.at_measured else request.position,
            request.reason or 'by hand',
            self._stamp or self._now(),
        )
        self._tell([edge], edge.stamp)
        response.success = True
        response.position = edge.report.frozen_position
        response.message = f'{request.joint} is held to be frozen at {response.position:.6g}'
        return response

    def _on_clear(
        self, request: ClearFault.Request, response: ClearFault.Response
    ) -> ClearFault.Response:
        edges = self._monitor.clear(request.joint, self._stamp or self._now(), request.reason)
        if edges:
            self._tell(edges, edges[0].stamp)
        response.cleared = [edge.report.name for edge in edges]
        response.success = bool(edges)
        response.message = (
            f'cleared {", ".join(response.cleared)}; each has to prove itself'
            if edges
            else f'{request.joint} has no fault to clear'
            if request.joint
            else 'no joint has a fault to clear'
        )
        return response

    def _tell(self, edges: Sequence[Edge], ns: int) -> None:
        """Publish changes of state; latched ones also go to the log and the state file."""
        self._publish_state(ns)
        for edge in edges:
            self._events.publish(fault_message(edge.report))
            report = edge.report
            if report.state in LATCHED:
                locked = report.state == JointState.LOCKED
                where = report.frozen_position if locked else report.position
                self.get_logger().error(
                    f'{report.name} {report.state.name} at {where:.6g}: {report.cause}'
                )
        if self._file and any(
            edge.report.state in LATCHED or edge.previous in LATCHED for edge in edges
        ):
            try:
                save_faults(self._file, self._chain.name, self._monitor.states())
            except OSError as error:
                self.complain('state file', f'faults will not survive a restart: {error}')

    def _publish_state(self, ns: int) -> None:
        reports = self._monitor.states()
        self._sequence += 1
        self._states.publish(state_message(reports, ns, self._sequence, self._frame))
        self._markers.publish(fault_markers(self._chain, reports, ns, self._frame))

    def _on_diagnostics(self) -> None:
        reports = self._monitor.states()
        silent = self._arrival is None or self._now() - self._arrival > _SILENT
        summary = DiagnosticStatus(
            name=f'{NODE}: {NODE}', hardware_id=self._chain.name, level=DiagnosticStatus.OK
        )
        faults = [r.name for r in reports if r.state in LATCHED]
        if not self.active:
            summary.level, summary.message = DiagnosticStatus.WARN, 'inactive'
        elif silent:
            summary.level, summary.message = DiagnosticStatus.STALE, 'no joint states'
        elif faults:
            summary.level = DiagnosticStatus.ERROR
            summary.message = f'faults: {", ".join(faults)}'
        elif not self._commanded:
            summary.level, summary.message = DiagnosticStatus.WARN, _BLIND
        else:
            summary.message = 'watching'
        summary.values = [KeyValue(key=MISSED, value=str(self._losses.lost))]
        if self._monitor.tool is not None:
            summary.values.append(KeyValue(key='tool', value=self._monitor.tool.text))
        self._diagnostics.publish(
            diagnostics_message(
                reports,
                self._chain.name,
                self._now(),
                summary,
                silent=silent,
                mimics=self._mimics.reports(),
            )
        )

    def _on_time_jump(self, jump: TimeJump) -> None:
        self.get_logger().warning('the clock jumped: evidence starts anew, faults stay')
        self._monitor.forget_time()


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(FaultMonitorNode, args)


if __name__ == '__main__':
    sys.exit(main())
