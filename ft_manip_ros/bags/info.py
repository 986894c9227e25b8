"""What is in a bag, and what of it a replay would miss."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from ft_manip_ros.bags.reader import Bag

# Relative topic name, type, and what a replay cannot do without it.
_NEEDED = (
    ('joint_states', 'sensor_msgs/msg/JointState', 'no fault can be replayed'),
    (
        'joint_trajectory_controller/joint_trajectory',
        'trajectory_msgs/msg/JointTrajectory',
        'the fault monitor sees no commanded motion',
    ),
    ('fault_events', 'ft_manip_interfaces/msg/JointFault', 'replayed faults have no counterpart'),
    ('fault_state', 'ft_manip_interfaces/msg/FaultState', 'the re-planner hears of no fault'),
    ('task', 'ft_manip_interfaces/msg/Task', 'there is nothing to plan'),
    (
        'recovery_plan',
        'ft_manip_interfaces/msg/RecoveryPlan',
        'replayed plans have no counterpart',
    ),
    (
        'workspace/query_ftws/_service_event',
        'ft_manip_interfaces/srv/QueryFtws_Event',
        'there are no verdicts to replay',
    ),
)
_NODES = ('fault_monitor', 'replanner', 'workspace')


def missing_for_replay(bag: Bag) -> list[str]:
    """Return a line on each thing that a replay needs and the bag lacks."""
    lines = []
    for name, type_name, consequence in _NEEDED:
        if not any(
            info.count
            and info.type_name == type_name
            and (topic == name or topic.endswith(f'/{name}'))
            for topic, info in bag.topics.items()
        ):
            lines.append(f'no {name} ({type_name}): {consequence}')
    for node in _NODES:
        if not any(
            name.startswith('parameters/') and name.rsplit('/', 1)[-1] == node
            for name in bag.provenance
        ):
            lines.append(f'no parameters of {node}: its defaults would be used')
    if not any(name.startswith('arm/') for name in bag.attachments):
        lines.append('no arm file: the one that the parameters name, or --arm, would be used')
    return lines


def summary(bag: Bag) -> dict[str, Any]:
    """Return what is in a bag as plain values."""
    return {
        'path': str(bag.path),
        'files': [
            {'name': s.path.name, 'bytes': s.path.stat().st_size, 'finished': s.finished}
            for s in bag.sources
        ],
        'start_ns': bag.start,
        'duration_s': (bag.end - bag.start) * 1e-9,
        'messages': bag.message_count,
        'topics': {
            topic: {
                'type': info.type_name,
                'count': info.count,
                'qos': [f'{q.reliability}, {q.durability}' for q in info.qos],
            }
            for topic, info in sorted(bag.topics.items())
        },
        'provenance': {k: v for k, v in sorted(bag.provenance.items()) if k != 'rosbag2'},
        'attachments': {k: len(v) for k, (_, v) in sorted(bag.attachments.items())},
        'notes': bag.notes,
        'missing_for_replay': missing_for_replay(bag),
    }


def lines(content: dict[str, Any]) -> Iterator[str]:
    """Yield a summary as lines for a person."""
    yield f'bag       {content["path"]}'
    for file in content['files']:
        state = '' if file['finished'] else ', NOT FINISHED'
        yield f'file      {file["name"]}, {file["bytes"] / 1024:.1f} KiB{state}'
    start = time.strftime('%Y-%m-%d %H:%M:%S UTC', time.gmtime(content['start_ns'] * 1e-9))
    yield f'start     {start if content["messages"] else "(no messages)"}'
    yield f'duration  {content["duration_s"]:.3f} s'
    yield f'messages  {content["messages"]}'
    width = max((len(topic) for topic in content['topics']), default=0)
    for topic, info in content['topics'].items():
        qos = '; '.join(dict.fromkeys(info['qos']))
        yield f'topic     {topic:<{width}}  {info["count"]:>7}  {info["type"]}  ({qos})'
    for name, values in content['provenance'].items():
        shown = ', '.join(f'{key}={value}' for key, value in values.items())
        yield f'about     {name}: {shown}'
    for name, size in content['attachments'].items():
        yield f'attached  {name} ({size} bytes)'
    for note in content['notes']:
        yield f'NOTE      {note}'
    for text in content['missing_for_replay']:
        yield f'missing   {text}'
