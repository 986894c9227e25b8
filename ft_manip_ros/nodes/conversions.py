"""Messages to core types and back; whatever does not fit is an `InputError` naming the field."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point, Pose, Quaternion
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ft_manip_interfaces.msg import DhParameters, TaskGoal
from ft_manip_interfaces.msg import Task as TaskMessage
from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.dh import DhTable
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import (
    DEFAULT_ORIENTATION_TOLERANCE,
    DEFAULT_POSITION_TOLERANCE,
    Goal,
    Task,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from ft_manip_ros.core.joint import Joint
from ft_manip_ros.core.joint_path import JointPath
from ft_manip_ros.core.planning.trajectory import Trajectory

if TYPE_CHECKING:
    from ft_manip_ros.core.detection.commands import TrajectoryPoint

_SECOND = 1_000_000_000


def nanoseconds(stamp: Time | Duration) -> int:
    """Return a stamp or duration as whole nanoseconds."""
    return int(stamp.sec) * _SECOND + int(stamp.nanosec)


def seconds(stamp: Time | Duration) -> float:
    """Return a stamp or duration in seconds; a present-day stamp is right to about 0.2 us."""
    return nanoseconds(stamp) * 1e-9


def stamp(ns: int) -> Time:
    """Return nanoseconds since the epoch as a message stamp."""
    return Time(sec=ns // _SECOND, nanosec=ns % _SECOND)


def duration(time: float) -> Duration:
    """Return seconds as a message duration, to the nearest nanosecond."""
    ns = round(time * _SECOND)
    return Duration(sec=ns // _SECOND, nanosec=ns % _SECOND)


def pose_to_message(position: Array, orientation: Array | None = None) -> Pose:
    """Pose of a position (3,) in m and a rotation matrix (3, 3), by default the identity."""
    x, y, z = (float(value) for value in position)
    pose = Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(w=1.0))
    if orientation is not None:
        qx, qy, qz, qw = (float(value) for value in quaternion_from_rotation(orientation))
        pose.orientation = Quaternion(x=qx, y=qy, z=qz, w=qw)
    return pose


def position_from_message(point: Point) -> Array:
    """Return a point as shape (3,), m, not checked (`Goal` does)."""
    return np.array([point.x, point.y, point.z])


def rotation_from_message(quaternion: Quaternion, where: str) -> Array:
    """Return a unit quaternion as a rotation matrix (3, 3), else raise `InputError`."""
    return rotation_from_quaternion(
        [quaternion.x, quaternion.y, quaternion.z, quaternion.w], where
    )


def goal_to_message(goal: Goal) -> TaskGoal:
    """Goal as a message."""
    return TaskGoal(
        id=goal.id,
        pose=pose_to_message(goal.position, goal.orientation),
        has_orientation=goal.orientation is not None,
        free_axis=goal.free_axis,
        position_tolerance=goal.position_tolerance,
        orientation_tolerance=goal.orientation_tolerance,
        straight_line=goal.straight_line,
    )


def goal_from_message(message: TaskGoal, name: str = '') -> Goal:
    """Goal of a message; ``name`` is its id where the message gives none."""
    name = message.id or name
    orientation = None
    if message.has_orientation:
        orientation = rotation_from_message(
            message.pose.orientation, f'goal {name!r}: orientation'
        )
    return Goal(
        position_from_message(message.pose.position),
        orientation,
        message.free_axis,
        message.position_tolerance or DEFAULT_POSITION_TOLERANCE,
        message.orientation_tolerance or DEFAULT_ORIENTATION_TOLERANCE,
        name,
        # Bags recorded before the field came do not have it.
        bool(getattr(message, 'straight_line', False)),
    )


def task_to_message(task: Task, ns: int, frame: str) -> TaskMessage:
    """Task as a message in ``frame``, the arm's base."""
    message = TaskMessage(name=task.name, goals=[goal_to_message(goal) for goal in task.goals])
    message.header.stamp = stamp(ns)
    message.header.frame_id = frame
    return message


def task_from_message(message: TaskMessage) -> Task:
    """Task of a message; goals without an id are called goal_1, goal_2, ..."""
    goals = [goal_from_message(goal, f'goal_{i + 1}') for i, goal in enumerate(message.goals)]
    return Task(message.name, tuple(goals))


def dh_to_message(table: DhTable) -> DhParameters:
    """DH table as a message."""
    joints = table.joints
    return DhParameters(
        name=table.name,
        joint_names=[joint.name for joint in joints],
        joint_types=[
            DhParameters.PRISMATIC if joint.prismatic else DhParameters.REVOLUTE
            for joint in joints
        ],
        d=table.d.tolist(),
        a=table.a.tolist(),
        alpha=table.alpha.tolist(),
        offset=table.offset.tolist(),
        lower=[joint.lower for joint in joints],
        upper=[joint.upper for joint in joints],
        operating_lower=[joint.operating[0] for joint in joints],
        operating_upper=[joint.operating[1] for joint in joints],
        velocity=[joint.velocity for joint in joints],
        acceleration=[joint.acceleration for joint in joints],
    )


def dh_from_message(message: DhParameters) -> DhTable:
    """DH table of a message; every array needs one entry per joint name."""
    n = len(message.joint_names)
    columns = ('joint_types', 'd', 'a', 'alpha', 'offset', 'lower', 'upper', 'operating_lower')
    for key in (*columns, 'operating_upper', 'velocity', 'acceleration'):
        if len(getattr(message, key)) != n:
            raise InputError(
                f'DH parameters: {key}', f'has {len(getattr(message, key))} entries; needs {n}'
            )
    for kind in message.joint_types:
        if kind not in (DhParameters.REVOLUTE, DhParameters.PRISMATIC):
            raise InputError('DH parameters: joint_types', f'has {kind}; must be 0 or 1')
    joints = tuple(
        Joint(
            message.joint_names[i],
            message.lower[i],
            message.upper[i],
            message.operating_lower[i],
            message.operating_upper[i],
            message.velocity[i],
            message.acceleration[i],
            message.joint_types[i] == DhParameters.PRISMATIC,
        )
        for i in range(n)
    )
    return DhTable(
        message.name,
        joints,
        np.array(message.d),
        np.array(message.a),
        np.array(message.alpha),
        np.array(message.offset),
    )


def trajectory_to_message(trajectory: Trajectory, ns: int = 0) -> JointTrajectory:
    """Trajectory for a joint_trajectory_controller; stamp 0 means "start when it arrives"."""
    message = JointTrajectory(joint_names=list(trajectory.joint_names))
    message.header.stamp = stamp(ns)
    message.points = [
        JointTrajectoryPoint(
            positions=q.tolist(),
            velocities=v.tolist(),
            accelerations=a.tolist(),
            time_from_start=duration(float(t)),
        )
        for t, q, v, a in zip(
            trajectory.times,
            trajectory.positions,
            trajectory.velocities,
            trajectory.accelerations,
            strict=True,
        )
    ]
    return message


def trajectory_points(message: JointTrajectory) -> list[TrajectoryPoint]:
    """Points as the fault monitor takes them: times (s) and values as they were sent."""
    return [
        (seconds(point.time_from_start), point.positions, point.velocities, point.accelerations)
        for point in message.points
    ]


def path_from_message(message: JointTrajectory, joint_names: Sequence[str]) -> JointPath:
    """Motion that a trajectory message asks for, its columns in the order of ``joint_names``.

    Raises
    ------
    InputError
        For no points, wrong array lengths, NaN, times that do not grow, joints that are unknown,
        missing or named twice, and velocities or accelerations given at some points only.
    """
    points = message.points
    n = len(message.joint_names)
    times = np.array([seconds(point.time_from_start) for point in points])
    columns: dict[str, Array | None] = {}
    for key in ('positions', 'velocities', 'accelerations'):
        lengths = {len(getattr(point, key)) for point in points}
        if key != 'positions' and lengths <= {0}:
            columns[key] = None
            continue
        if lengths - {n}:
            raise InputError(
                f'trajectory: {key}', f'have lengths {sorted(lengths)}; {n} joints are named'
            )
        columns[key] = np.array([getattr(point, key) for point in points]).reshape(-1, n)
    if not points:
        raise InputError('trajectory', 'has no points; at least one is needed')
    positions = columns['positions']
    assert positions is not None
    path = JointPath(
        tuple(message.joint_names),
        times,
        positions,
        columns['velocities'],
        columns['accelerations'],
    )
    return path.ordered(joint_names)
