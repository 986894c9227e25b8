"""Parameters of the node `recorder`."""

from __future__ import annotations

from rclpy.parameter import Parameter

from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.parameters import ParameterSpec

CONTINUOUS, SNAPSHOT = 'continuous', 'snapshot'

TOPICS = (
    topics.JOINT_STATES,
    topics.JOINT_TRAJECTORY,
    topics.TOOL_POSE,
    topics.TASK,
    topics.FAULT_STATE,
    topics.FAULT_EVENTS,
    topics.COMMANDS_HEARD,
    topics.RECOVERY_PLAN,
    'replanner/task_plan',
    topics.DESIGN_CANDIDATES,
    topics.DESIGN_BEST,
    topics.DESIGN_FINAL,
    topics.ROBOT_DESCRIPTION,
    *(topics.markers(node) for node in ('fault_monitor', 'replanner', 'workspace', 'designer')),
    'replanner/path',
    topics.FTWS_MAP,
    topics.FTWS_MAP_MARKERS,
    topics.DIAGNOSTICS,
    '/parameter_events',
    '/rosout',
)
SERVICES = (topics.QUERY_FTWS, topics.FREEZE_JOINT, topics.CLEAR_FAULT, topics.INJECT_FAULT)
NODES = ('designer', 'workspace', 'fault_monitor', 'replanner', 'arm_sim')

PARAMETERS = (
    ParameterSpec(
        'output',
        '',
        'Folder of the bag, not existing yet; empty: out/recording_<time>. In snapshot mode: '
        'the folder that the bags go into.',
    ),
    ParameterSpec(
        'mode',
        CONTINUOUS,
        'Record everything, or only what surrounds a fault.',
        choices=(CONTINUOUS, SNAPSHOT),
    ),
    ParameterSpec(
        'snapshot_before', 10.0, 'Snapshot mode: kept before a fault.', 's', 0.0, 3600.0
    ),
    ParameterSpec(
        'snapshot_after', 5.0, 'Snapshot mode: recorded after the last fault.', 's', 0.0, 3600.0
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
