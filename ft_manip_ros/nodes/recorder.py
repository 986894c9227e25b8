"""Node `recorder`: everything on the graph to one crash-safe, rosbag2-compatible bag."""

from __future__ import annotations

import os
import platform
import sys
import time
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.parameter import Parameter

from ft_manip_ros.bags.definitions import message_definition
from ft_manip_ros.bags.qos import QosProfile
from ft_manip_ros.bags.recording import Recording, RecordingStatus
from ft_manip_ros.bags.rosbag_metadata import FILE_NAME
from ft_manip_ros.bags.writer import BagWriter
from ft_manip_ros.bags.writer_settings import WriterSettings
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.managed_node import ManagedNode
from ft_manip_ros.nodes.parameter_capture import ParameterCapture
from ft_manip_ros.nodes.parameters import ParameterSpec
from ft_manip_ros.nodes.process import run
from ft_manip_ros.nodes.topic_capture import TopicCapture

_MIB = 1 << 20
_POLL = 0.02  # s, between takes
_DISCOVERY = 0.1  # s, between looks at the graph
_DIAGNOSTICS = 1.0  # s

TOPICS = (
    topics.JOINT_STATES,
    topics.JOINT_TRAJECTORY,
    topics.TASK,
    topics.FAULT_STATE,
    topics.FAULT_EVENTS,
    topics.RECOVERY_PLAN,
    'replanner/task_plan',
    topics.DESIGN_CANDIDATES,
    topics.DESIGN_BEST,
    topics.DESIGN_FINAL,
    topics.ROBOT_DESCRIPTION,
    topics.DIAGNOSTICS,
    '/parameter_events',
    '/rosout',
)
SERVICES = (topics.QUERY_FTWS, topics.FREEZE_JOINT, topics.CLEAR_FAULT, topics.INJECT_FAULT)
NODES = ('designer', 'workspace', 'fault_monitor', 'replanner', 'arm_sim')

PARAMETERS = (
    ParameterSpec(
        'output', '', 'Folder of the bag, not existing yet; empty: out/recording_<time>.'
    ),
    ParameterSpec('topics', list(TOPICS), 'Topics to record; names may be relative.'),
    ParameterSpec('services', list(SERVICES), 'Services whose requests and responses to record.'),
    ParameterSpec('all_topics', False, 'Record every topic that is not hidden.'),
    ParameterSpec(
        'parameter_nodes', list(NODES), 'Nodes whose parameters and arm files go into the bag.'
    ),
    ParameterSpec(
        'compression', 'zstd', 'Compression of chunks.', choices=('zstd', 'lz4', 'none')
    ),
    ParameterSpec('chunk_size', 1024, 'Largest chunk.', 'KiB', 1, 65536),
    ParameterSpec(
        'flush_interval', 1.0, 'Longest time that a message waits in memory.', 's', 0.05, 60.0
    ),
    ParameterSpec('sync', False, 'Also wait for the disk at each flush, against loss of power.'),
    ParameterSpec('split_size', 0, 'New file beyond this size; 0: never.', 'MiB', 0, 2**20),
    ParameterSpec(
        'split_duration', 0.0, 'New file beyond this time span; 0: never.', 's', 0.0, 1e6
    ),
    ParameterSpec(
        'queue_size', 64, 'Memory for messages that wait for the disk.', 'MiB', 1, 2**16
    ),
    ParameterSpec('note', '', "Text kept in the bag's provenance, e.g. what the run is for."),
    ParameterSpec(
        'seed', Parameter.Type.INTEGER, "Seed of the run, kept in the bag's provenance."
    ),
)


class Recorder(ManagedNode):
    """Records from the moment it is activated until it is deactivated."""

    def __init__(self) -> None:
        super().__init__('recorder', PARAMETERS)
        self._recording: Recording | None = None

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
        self.create_timer(_DIAGNOSTICS, self._publish_diagnostics)
        self.every(_POLL, self._on_poll)
        self.every(_DISCOVERY, self._on_discovery)

    def activate(self) -> None:
        """Open the bag and begin."""
        folder = Path(self.param('output') or time.strftime('out/recording_%Y%m%d_%H%M%S'))
        self._report_unfinished(folder.parent)
        writer = BagWriter(folder, self._settings)
        writer.add_provenance('ft_manip_ros', self._provenance())
        self._folder = folder
        self._recording = Recording(writer, self.param('queue_size') * _MIB)
        self._capture = TopicCapture(self, self._is_wanted, self._announce, self.complain)
        self._parameters = ParameterCapture(
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
        self._parameters.close()
        status = recording.close()
        text = f'{self._folder}: {status.written} messages'
        if losses := _losses(status, self._capture.lost):
            self.get_logger().error(f'{text}, {losses}')
        else:
            self.get_logger().info(f'{text}, none lost')

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

    def _if_open(self, method: str, *args: object) -> None:
        if self._recording is not None:
            getattr(self._recording, method)(*args)

    def _on_poll(self) -> None:
        if self._recording is not None:
            self._recording.put(self._capture.take())

    def _on_discovery(self) -> None:
        if self._recording is not None:
            self._capture.discover()
            self._parameters.discover()

    def _report_unfinished(self, parent: Path) -> None:
        """Name the bags beside the new one that were not closed, as after a crash."""
        if not parent.is_dir():
            return
        for folder in sorted(parent.iterdir()):
            if any(folder.glob('*.mcap')) and not (folder / FILE_NAME).is_file():
                self.get_logger().warning(
                    f'{folder} was not closed: ftmanip bag recover {folder} repairs it'
                )

    def _provenance(self) -> dict[str, str]:
        values = {
            'python': platform.python_version(),
            'machine': f'{platform.system()} {platform.machine()}',
            'middleware': rclpy.get_rmw_implementation_identifier(),
            'ros_distro': os.environ.get('ROS_DISTRO', ''),
            'domain': os.environ.get('ROS_DOMAIN_ID', '0'),
            'started': time.strftime('%Y-%m-%dT%H:%M:%SZ', time.gmtime()),
            'note': self.param('note'),
        }
        seed = self.param('seed')
        if seed != []:
            values['seed'] = str(seed)
        for package in ('ft_manip_ros', 'numpy', 'numba', 'pin', 'mcap'):
            try:
                values[f'version.{package}'] = metadata.version(package)
            except metadata.PackageNotFoundError:
                continue
        return {key: value for key, value in values.items() if value}

    def _publish_diagnostics(self) -> None:
        status = DiagnosticStatus(name=f'{self.get_name()}: bag', hardware_id=self.get_name())
        if self._recording is None:
            status.level, status.message = DiagnosticStatus.OK, 'not recording'
        else:
            _fill(status, self._recording.status(), self._capture, self._folder)
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)


def _losses(status: RecordingStatus, lost: int) -> str:
    parts = []
    if status.error:
        parts.append(f'the disk refuses: {status.error}')
    unwritten = status.received - sum(status.dropped.values()) - status.written
    for count, what in (
        (sum(status.dropped.values()), 'dropped for lack of memory'),
        (lost, 'lost by the middleware'),
        (unwritten, 'not written'),
    ):
        if count > 0:
            parts.append(f'{count} {what}')
    return ', '.join(parts)


def _fill(
    message: DiagnosticStatus, status: RecordingStatus, capture: TopicCapture, folder: Path
) -> None:
    dropped = sum(status.dropped.values())
    message.level, message.message = DiagnosticStatus.OK, f'recording to {folder}'
    if dropped or capture.lost:
        message.level = DiagnosticStatus.WARN
        message.message = f'{dropped} messages dropped, {capture.lost} lost by the middleware'
    if status.error:
        message.level, message.message = DiagnosticStatus.ERROR, status.error
    values = {
        'bag': str(folder),
        'received': status.received,
        'written': status.written,
        'dropped': dropped,
        'lost by the middleware': capture.lost,
        'queued bytes': status.queued_bytes,
        'topics': len(capture.topics),
        **{f'dropped on {topic}': count for topic, count in status.dropped.items()},
    }
    message.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until Ctrl-C or SIGTERM."""
    return run(Recorder, args)


if __name__ == '__main__':
    sys.exit(main())
