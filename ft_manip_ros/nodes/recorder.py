"""Node `recorder`: everything on the graph to one crash-safe, rosbag2-compatible bag."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from pathlib import Path

import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.serialization import deserialize_message
from std_srvs.srv import Trigger

from ft_manip_interfaces.msg import JointFault
from ft_manip_ros.bags.definitions import message_definition
from ft_manip_ros.bags.qos import QosProfile
from ft_manip_ros.bags.recording import CLOSE_TIME, Recorded, Recording
from ft_manip_ros.bags.rosbag_metadata import FILE_NAME
from ft_manip_ros.bags.snapshot import SnapshotRecording
from ft_manip_ros.bags.writer import BagWriter
from ft_manip_ros.bags.writer_settings import WriterSettings
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.managed_node import ManagedNode
from ft_manip_ros.nodes.parameter_capture import ParameterCapture
from ft_manip_ros.nodes.process import run
from ft_manip_ros.nodes.recorder_parameters import PARAMETERS, SNAPSHOT
from ft_manip_ros.nodes.recorder_status import diagnostic, losses, provenance
from ft_manip_ros.nodes.topic_capture import TopicCapture

SAVE_SNAPSHOT = 'recorder/save_snapshot'  # std_srvs/srv/Trigger

_MIB = 1 << 20
_POLL = 0.02  # s, between takes
_DISCOVERY = 0.1  # s, between looks at the graph
_DIAGNOSTICS = 1.0  # s
_GRACE = CLOSE_TIME + 2.0  # s, to finish the bag after Ctrl-C
_INPUTS = ('reference_topic', 'tool_pose_topic')  # parameters that name topics
_FAULT_TYPE = 'ft_manip_interfaces/msg/JointFault'
_TRIGGERS = (JointFault.LOCKED, JointFault.RUNAWAY)


class Recorder(ManagedNode):
    """Records from the moment it is activated until it is deactivated."""

    def __init__(self) -> None:
        super().__init__('recorder', PARAMETERS)
        self._recording: Recording | SnapshotRecording | None = None

    def configure(self) -> None:
        """Check the settings and where the bag is to go; nothing is written yet."""
        self._settings = WriterSettings(
            compression=self.param('compression'),
            chunk_size=self.param('chunk_size') * 1024,
            flush_interval=self.param('flush_interval'),
            sync=self.param('sync'),
            split_size=self.param('split_size') * _MIB,
            split_duration=self.param('split_duration'),
        )
        named = [self.resolve_topic_name(name) for name in self.param('topics') if name]
        events = [
            self.resolve_topic_name(topics.service_events(self.resolve_service_name(name)))
            for name in self.param('services')
            if name
        ]
        self._wanted = frozenset(named + events)
        self._all = self.param('all_topics')
        self._nodes = frozenset(self.param('parameter_nodes'))
        # Diagnostics are for those who look from outside: also while inactive.
        self._diagnostics = self.create_publisher(
            DiagnosticArray, topics.DIAGNOSTICS, topics.COMMAND_QOS
        )
        self.serve(Trigger, SAVE_SNAPSHOT, self._on_save)
        # On a clock that runs: with use_sim_time the others' may stand still, and messages and
        # publishers come all the same.
        for period, callback in (
            (_POLL, self._on_poll),
            (_DISCOVERY, self._on_discovery),
            (_DIAGNOSTICS, self._publish_diagnostics),
        ):
            self.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def activate(self) -> None:
        """Open the bag and begin."""
        folder = Path(self.param('output') or time.strftime('out/recording_%Y%m%d_%H%M%S'))
        self._report_unfinished(folder.parent)
        self._folder = folder
        self._recording = self._begin(folder)
        seed = self.param('seed')
        self._recording.add_provenance(
            'ft_manip_ros', provenance(self.param('note'), None if seed == [] else seed)
        )
        simulated = self.get_parameter('use_sim_time').value
        self._capture = TopicCapture(
            self,
            self._is_wanted,
            self._announce,
            self.complain,
            self._now if simulated else None,
        )
        self._parameter_capture = ParameterCapture(
            self,
            self._nodes.__contains__,
            self._on_parameters,
            lambda *file: self._if_open('add_attachment', *file),
        )
        self._on_discovery()
        self.get_logger().info(f'recording to {folder}')

    def deactivate(self) -> None:
        """Take what has arrived, finish the bag and say what is in it."""
        recording, self._recording = self._recording, None
        if recording is None:
            return
        recording.put(self._capture.take())
        self._capture.close()
        self._parameter_capture.close()
        status = recording.close()
        text = f'{self._folder}: {status.written} messages'
        if isinstance(recording, SnapshotRecording):
            # What no fault was near is left out on purpose.
            status.received = status.written + sum(status.dropped.values())
            text = f'{self._folder}: {recording.count} snapshots, {status.written} messages'
        if missing := losses(status, self._capture.lost):
            self.get_logger().error(f'{text}, {missing}')
        else:
            self.get_logger().info(f'{text}, none lost')

    def _now(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    def _begin(self, folder: Path) -> Recording | SnapshotRecording:
        capacity = self.param('queue_size') * _MIB
        if self.param('mode') != SNAPSHOT:
            return Recording(BagWriter(folder, self._settings), capacity)
        return SnapshotRecording(
            folder,
            self._settings,
            before=self.param('snapshot_before'),
            after=self.param('snapshot_after'),
            capacity=capacity,
            announce=lambda bag: self.get_logger().info(f'snapshot: {bag}'),
        )

    def _is_wanted(self, topic: str) -> bool:
        if topic in self._wanted:
            return True
        return bool(self._all) and not any(part.startswith('_') for part in topic.split('/'))

    def _announce(self, topic: str, type_name: str, qos: tuple[QosProfile, ...]) -> None:
        if self._recording is not None:
            self._recording.add_topic(topic, message_definition(type_name), qos)

    def _on_parameters(self, node: str, values: dict[str, str]) -> None:
        self._if_open('add_provenance', f'parameters{node}', values)
        self.get_logger().info(f'has the parameters of {node}')
        # What the monitor listens to by another name is as much evidence as the joint states.
        space = node.rpartition('/')[0]
        for key in _INPUTS:
            topic = yaml.safe_load(values.get(key, '')) or ''
            if topic:
                self._wanted |= {topic if topic.startswith('/') else f'{space}/{topic}'}

    def _if_open(self, method: str, *args: object) -> None:
        if self._recording is not None:
            getattr(self._recording, method)(*args)

    def _on_poll(self) -> None:
        if self._recording is None:
            return
        messages = self._capture.take()
        self._recording.put(messages)
        if isinstance(self._recording, SnapshotRecording):
            for message in messages:
                if message.type_name == _FAULT_TYPE and _is_trigger(message):
                    self._trigger(message.log_time)

    def _on_save(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not isinstance(self._recording, SnapshotRecording):
            raise InputError('mode', "is not 'snapshot': everything is being recorded")
        self._trigger(self._now())
        response.success = True
        response.message = f'the last {self._recording.span:.1f} s are being written'
        return response

    def _trigger(self, stamp: int) -> None:
        assert isinstance(self._recording, SnapshotRecording)
        try:
            self._recording.trigger(stamp)
        except (InputError, OSError) as error:
            self.complain('snapshot', f'the snapshot cannot be written: {error}')

    def _on_discovery(self) -> None:
        if self._recording is not None:
            self._capture.discover()
            self._parameter_capture.discover()

    def _report_unfinished(self, parent: Path) -> None:
        """Name the bags beside the new one that were not closed, as after a crash."""
        if not parent.is_dir():
            return
        for folder in sorted(parent.iterdir()):
            if any(folder.glob('*.mcap')) and not (folder / FILE_NAME).is_file():
                self.get_logger().warning(
                    f'{folder} was not closed: ftmanip bag recover {folder} repairs it'
                )

    def _publish_diagnostics(self) -> None:
        if self._recording is None:
            name = self.get_name()
            status = DiagnosticStatus(
                name=f'{name}: bag',
                hardware_id=name,
                level=DiagnosticStatus.OK,
                message='not recording',
            )
        else:
            capture = self._capture
            status = diagnostic(
                self.get_name(),
                self._recording.status(),
                capture.lost,
                len(capture.topics),
                self._folder,
            )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)


def _is_trigger(message: Recorded) -> bool:
    try:
        return deserialize_message(message.data, JointFault).state in _TRIGGERS
    except Exception:  # noqa: BLE001 - rclpy names no error for bytes that do not fit
        return False


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until Ctrl-C or SIGTERM."""
    return run(Recorder, args, grace=_GRACE)


if __name__ == '__main__':
    sys.exit(main())
