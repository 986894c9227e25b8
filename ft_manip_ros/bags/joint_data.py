"""Joint states and commanded motion of a bag, as the fault monitor takes them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from ft_manip_ros.bags.reader import Bag
from ft_manip_ros.core.detection.feed import MonitorFeed
from ft_manip_ros.core.detection.states import Edge
from ft_manip_ros.core.errors import InputError

JOINT_STATE = 'sensor_msgs/msg/JointState'
TRAJECTORY = 'trajectory_msgs/msg/JointTrajectory'
POSE = 'geometry_msgs/msg/PoseStamped'
CONTROLLER_STATE = 'control_msgs/msg/JointTrajectoryControllerState'
_SECOND = 1_000_000_000


def joint_state_topics(bag: Bag) -> list[str]:
    """Topics called ``joint_states``; any JointState topic where none is.

    Raises
    ------
    InputError
        If the bag has no JointState topic.
    """
    topics = [name for name, info in bag.topics.items() if info.type_name == JOINT_STATE]
    if not topics:
        raise InputError(
            f'bag {bag.path}',
            f'has no topic of type {JOINT_STATE}; it has {sorted(bag.topics)}',
        )
    return [name for name in topics if name.rpartition('/')[2] == 'joint_states'] or topics


def joint_names(bag: Bag, topics: Iterable[str]) -> tuple[str, ...]:
    """Names of all joints that the topics report, in order of appearance."""
    names: dict[str, None] = {}
    for message in bag.messages(set(topics)):
        try:
            names.update(dict.fromkeys(bag.decode_expected(message).name))
        except InputError:
            continue
    return tuple(names)


def feed_bag(
    bag: Bag,
    feed: MonitorFeed,
    topics: Iterable[str],
    *,
    reference: str | None = None,
    tool: str | None = None,
    on_sample: Callable[[int], None] | None = None,
) -> tuple[list[Edge], list[str]]:
    """Feed a bag in the order of its log times.

    Parameters
    ----------
    topics
        Topics with joint states.
    reference
        A JointState topic with commanded positions.
    tool
        A PoseStamped topic with poses of the tool in the frame of the arm's base.
    on_sample
        Called with its stamp (ns) after each joint state.

    Returns
    -------
    list of Edge
        Changes of state.
    list of str
        What was wrong with messages that were left out.
    """
    states = set(topics)
    kinds = dict.fromkeys(states, JOINT_STATE)
    for name, info in bag.topics.items():
        if info.type_name in (TRAJECTORY, CONTROLLER_STATE):
            kinds[name] = info.type_name
    for what, topic, kind in (('reference', reference, JOINT_STATE), ('tool', tool, POSE)):
        if topic is None:
            continue
        if topic not in bag.topics:
            raise InputError(
                f'{what} topic', f'{topic!r} is none of {", ".join(sorted(bag.topics))}'
            )
        if bag.topics[topic].type_name != kind:
            raise InputError(
                f'{what} topic', f'{topic!r} is {bag.topics[topic].type_name}; {kind} is needed'
            )
        kinds[topic] = kind
    edges: list[Edge] = []
    problems: list[str] = []
    for message in bag.messages(set(kinds)):
        try:
            content = bag.decode_expected(message)
            if message.topic in states:
                edges += _joint_state(feed, content, message.log_time)
                if on_sample is not None:
                    on_sample(_stamp(content.header) or message.log_time)
            elif kinds[message.topic] == TRAJECTORY:
                _trajectory(feed, content, message.log_time)
            elif kinds[message.topic] == POSE:
                place = content.pose.position
                feed.tool_pose(
                    _stamp(content.header),
                    message.log_time,
                    content.header.frame_id,
                    (place.x, place.y, place.z),
                )
            elif kinds[message.topic] == CONTROLLER_STATE:
                wanted = getattr(content, 'reference', None) or content.desired
                feed.reference(
                    _stamp(content.header), message.log_time, content.joint_names, wanted.positions
                )
            else:
                feed.reference(
                    _stamp(content.header), message.log_time, content.name, content.position
                )
        except InputError as error:
            problems.append(f'{message.topic} at {message.log_time} ns: {error}')
    return edges, problems


def _joint_state(feed: MonitorFeed, message: Any, arrival: int) -> list[Edge]:
    return feed.joint_state(
        _stamp(message.header),
        arrival,
        message.name,
        message.position,
        message.velocity,
        message.effort,
    )


def _trajectory(feed: MonitorFeed, message: Any, arrival: int) -> None:
    points = [
        (
            _stamp(point, 'time_from_start') * 1e-9,
            point.positions,
            point.velocities,
            point.accelerations,
        )
        for point in message.points
    ]
    feed.trajectory(_stamp(message.header), arrival, message.joint_names, points)


def _stamp(holder: Any, field: str = 'stamp') -> int:
    time = getattr(holder, field)
    return int(time.sec) * _SECOND + int(time.nanosec)
