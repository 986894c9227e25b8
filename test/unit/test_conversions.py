"""Messages and core types: there and back, and what is refused by name."""

from __future__ import annotations

import math

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Quaternion
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ft_manip_ros.core.dh import DhTable
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import Goal, Task
from ft_manip_ros.core.joint import Joint
from ft_manip_ros.core.planning.trajectory import Trajectory
from ft_manip_ros.nodes import conversions as convert

QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
TASK = Task(
    'mixed',
    (
        Goal(np.array([0.1, 0.2, 0.3]), id='where'),
        Goal(np.array([1.0, 0.0, -1.0]), QUARTER, True, 2e-3, 0.1, 'how', True),
    ),
)


def table():
    joints = (
        Joint('slide', -0.5, 0.5, velocity=0.3, acceleration=1.5, prismatic=True),
        Joint('turn', -2.0, 1.0, operating_lower=-1.0, operating_upper=0.5),
    )
    columns = (np.array(c) for c in ([0.1, 0.2], [0.3, 0.0], [0.5, -1.5], [0.0, 0.7]))
    return DhTable('two', joints, *columns)


def test_a_task_survives_the_round_trip():
    back = convert.task_from_message(convert.task_to_message(TASK, 5, 'base'))
    assert back.name == TASK.name
    for a, b in zip(back.goals, TASK.goals, strict=True):
        np.testing.assert_array_equal(a.position, b.position)
        assert (a.orientation is None) == (b.orientation is None)
        if a.orientation is not None:
            np.testing.assert_allclose(a.orientation, b.orientation, atol=1e-12)
        assert (a.id, a.free_axis) == (b.id, b.free_axis)
        assert a.straight_line == b.straight_line
        assert a.position_tolerance == b.position_tolerance
        assert a.orientation_tolerance == b.orientation_tolerance


def test_what_a_goal_message_leaves_out_is_filled_in():
    message = convert.task_to_message(TASK, 0, 'base')
    message.goals[0].id = ''
    message.goals[0].position_tolerance = 0.0
    goal = convert.task_from_message(message).goals[0]
    assert goal.id == 'goal_1'
    assert goal.position_tolerance == 1e-3


@pytest.mark.parametrize(
    ('change', 'field'),
    [
        (lambda m: setattr(m.goals[0].pose.position, 'x', math.nan), "goal 'where': position"),
        (lambda m: setattr(m.goals[0], 'position_tolerance', math.nan), 'position_tolerance'),
        (lambda m: setattr(m.goals[0], 'position_tolerance', -1.0), 'position_tolerance'),
        (lambda m: setattr(m.goals[1].pose, 'orientation', Quaternion(w=3.0)), "'how': orient"),
        (lambda m: setattr(m.goals[1], 'has_orientation', False), 'free_axis'),
        (lambda m: setattr(m, 'goals', []), 'no goals'),
    ],
)
def test_malformed_tasks_are_refused_by_field(change, field):
    message = convert.task_to_message(TASK, 0, 'base')
    change(message)
    with pytest.raises(InputError, match=field):
        convert.task_from_message(message)


def test_a_dh_table_survives_the_round_trip():
    back, given = convert.dh_from_message(convert.dh_to_message(table())), table()
    assert (back.name, back.joints[0]) == (given.name, back.joints[0])
    for a, b in zip(back.joints, given.joints, strict=True):
        assert (a.name, a.prismatic, a.operating) == (b.name, b.prismatic, b.operating)
        assert (a.lower, a.upper, a.velocity, a.acceleration) == (
            (b.lower, b.upper, b.velocity, b.acceleration)
        )
    for key in ('d', 'a', 'alpha', 'offset'):
        np.testing.assert_array_equal(getattr(back, key), getattr(given, key))


@pytest.mark.parametrize('key', ['d', 'joint_types', 'upper', 'operating_upper', 'velocity'])
def test_dh_columns_of_another_length_are_refused(key):
    message = convert.dh_to_message(table())
    setattr(message, key, list(getattr(message, key))[:1])
    with pytest.raises(InputError, match=key):
        convert.dh_from_message(message)


def test_an_unknown_joint_type_is_refused():
    message = convert.dh_to_message(table())
    message.joint_types = [0, 5]
    with pytest.raises(InputError, match='joint_types'):
        convert.dh_from_message(message)


def test_a_trajectory_survives_the_round_trip_in_any_joint_order():
    rng = np.random.default_rng(3)
    q, v, a = (rng.normal(size=(4, 2)) for _ in range(3))
    times = np.array([0.0, 0.1, 1.3, 1_000_000.25])
    message = convert.trajectory_to_message(Trajectory(('a', 'b'), times, q, v, a))
    path = convert.path_from_message(message, ['b', 'a'])
    np.testing.assert_allclose(path.times, times, atol=1e-9)
    np.testing.assert_array_equal(path.positions, q[:, ::-1])
    np.testing.assert_array_equal(path.velocities, v[:, ::-1])
    np.testing.assert_array_equal(path.accelerations, a[:, ::-1])


def test_positions_alone_make_a_path():
    message = JointTrajectory(joint_names=['a'], points=[JointTrajectoryPoint(positions=[1.0])])
    path = convert.path_from_message(message, ['a'])
    assert path.velocities is None
    assert path.accelerations is None


@pytest.mark.parametrize(
    ('points', 'field'),
    [
        ([], 'no points'),
        ([{'positions': [1.0, 2.0]}], 'positions'),
        ([{'positions': [math.nan]}], 'positions'),
        ([{'positions': [1.0], 'velocities': [1.0, 2.0]}], 'velocities'),
        ([{'positions': [1.0]}, {'positions': [1.0]}], 'time_from_start'),
    ],
)
def test_malformed_trajectories_are_refused_by_field(points, field):
    message = JointTrajectory(joint_names=['a'])
    message.points = [JointTrajectoryPoint(**point) for point in points]
    with pytest.raises(InputError, match=field):
        convert.path_from_message(message, ['a'])


@pytest.mark.parametrize('ns', [0, 1, 999_999_999, 1_000_000_000, 1_795_306_885_468_325_064])
def test_stamps_are_exact(ns):
    assert convert.nanoseconds(convert.stamp(ns)) == ns
    assert convert.seconds(Time(sec=2, nanosec=500_000_000)) == 2.5


@pytest.mark.parametrize('time', [0.0, 0.1, 0.9999999999, 12.345678901, 1e6])
def test_durations_are_right_to_the_nanosecond(time):
    message = convert.duration(time)
    assert isinstance(message, Duration)
    assert convert.seconds(message) == pytest.approx(time, abs=6e-10)
