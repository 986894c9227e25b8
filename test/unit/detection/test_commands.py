"""Commanded motion as a joint_trajectory_controller runs it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import BPoly

from ft_manip_ros.core.detection.commands import CommandBook, point_table
from ft_manip_ros.core.detection.feed import MonitorFeed
from ft_manip_ros.core.detection.monitor import FaultMonitor
from ft_manip_ros.core.detection.spline import hermite
from ft_manip_ros.core.errors import InputError

ALL = np.arange(2)
NAN = np.full((3, 2), np.nan)


def trajectory(book, start, times, positions, velocities=None, accelerations=None, joints=ALL):
    times = np.array(times, dtype=float)
    positions = np.array(positions, dtype=float).reshape(len(times), len(joints))
    nan = np.full(positions.shape, np.nan)
    book.trajectory(
        start,
        joints,
        times,
        positions,
        nan if velocities is None else np.array(velocities, dtype=float),
        nan if accelerations is None else np.array(accelerations, dtype=float),
        np.zeros(2),
    )


@pytest.mark.parametrize('derivatives', [0, 1, 2])
def test_interpolation_is_hermite_of_the_given_derivatives(derivatives):
    rng = np.random.default_rng(derivatives)
    times = np.array([0.0, 0.4, 1.1])
    values = rng.normal(size=(3, 3, 2))
    given = [values[k] if k <= derivatives else NAN for k in range(3)]
    book = CommandBook(2)
    book.trajectory(5.0, ALL, times, *given, np.zeros(2))
    for j in range(2):
        points = [[values[d][k, j] for d in range(derivatives + 1)] for k in range(3)]
        reference = BPoly.from_derivatives(times, points)
        for t in np.linspace(0.0, 1.1, 23):
            assert book.at(5.0 + t)[j] == pytest.approx(float(reference(t)), abs=1e-12)


def test_a_trajectory_begins_where_the_command_stands_and_holds_its_end():
    book = CommandBook(2)
    assert np.isnan(book.at(0.0)).all()
    trajectory(book, 10.0, [1.0], [[1.0, -1.0]])
    assert np.isnan(book.at(9.9)).all()
    np.testing.assert_allclose(book.at(10.5), [0.5, -0.5])
    np.testing.assert_allclose(book.at(99.0), [1.0, -1.0])
    trajectory(book, 100.0, [2.0], [[2.0, 0.0]])
    np.testing.assert_allclose(book.at(101.0), [1.5, -0.5])


def test_a_trajectory_for_later_leaves_the_present_one_alone_until_then():
    book = CommandBook(2)
    trajectory(book, 0.0, [1.0], [[1.0, 1.0]])
    trajectory(book, 5.0, [1.0], [[0.0, 0.0]])
    np.testing.assert_allclose(book.at(0.5), [0.5, 0.5])
    np.testing.assert_allclose(book.at(4.9), [1.0, 1.0])
    np.testing.assert_allclose(book.at(5.5), [0.5, 0.5])


def test_a_subset_of_joints_is_taken_over_and_the_others_go_on():
    book = CommandBook(2)
    trajectory(book, 0.0, [2.0], [[2.0, 2.0]])
    trajectory(book, 1.0, [1.0], [[0.0]], joints=np.array([1]))
    np.testing.assert_allclose(book.at(1.5), [1.5, 0.5])


def test_no_points_mean_hold_and_references_take_over():
    book = CommandBook(2)
    trajectory(book, 0.0, [2.0], [[2.0, 2.0]])
    trajectory(book, 1.0, [], [])
    np.testing.assert_allclose(book.at(7.0), [1.0, 1.0])
    book.reference(8.0, np.array([0]), np.array([3.0]))
    np.testing.assert_allclose(book.at(7.9), [1.0, 1.0])
    np.testing.assert_allclose(book.at(8.0), [3.0, 1.0])


@pytest.mark.parametrize('referenced', [False, True])
def test_many_times_at_once_are_as_one_by_one(referenced):
    """Three trajectories, one of a single joint, and perhaps set points in between."""

    def made():
        book = CommandBook(2)
        trajectory(book, 0.5, [1.0, 2.0], [[1.0, 2.0], [0.0, 1.0]])
        trajectory(book, 2.0, [1.0], [[-1.0]], joints=np.array([1]))
        if referenced:
            book.reference(2.5, np.array([0]), np.array([3.0]))
        else:
            trajectory(book, 2.6, [1.0], [[5.0, 5.0]])
        return book

    times = np.sort(np.random.default_rng(7).uniform(0.0, 5.0, 60))
    book = made()
    expected = np.array([book.at(t).copy() for t in times])
    assert np.isnan(expected[0, 1])
    assert np.isfinite(expected[-1]).all()
    np.testing.assert_array_equal(made().over(times), expected)


def test_coefficients_of_one_piece():
    rest = np.zeros((2, 1))
    (piece,) = hermite(np.array([0.0, 2.0]), np.array([[0.0], [1.0]]), rest, rest)
    np.testing.assert_allclose(piece[:, 0], [0, 0, 0, 10 / 8, -15 / 16, 6 / 32])


@pytest.mark.parametrize(
    ('points', 'complaint'),
    [
        ([(0.0, [1.0], [], [])], r'points\[0\]\.positions: has 1 values; 2 joints'),
        ([(0.0, [1.0, math.nan], [], [])], 'contains NaN'),
        ([(0.0, [1.0, 1.0], [0.0], [])], r'points\[0\]\.velocities: has 1'),
        ([(1.0, [0, 0], [], []), (1.0, [1, 1], [], [])], 'do not grow'),
        ([(-1.0, [0, 0], [], [])], 'negative'),
        ([(math.nan, [0, 0], [], [])], 'negative or do not grow'),
        # Times that differ in name only: a piece of no length has no speed.
        ([(0.0, [0, 0], [], []), (1e-160, [1, 1], [], [])], 'do not grow by a nanosecond'),
        ([(5e-324, [0, 0], [], [])], 'do not grow by a nanosecond'),
    ],
)
def test_malformed_trajectories_name_the_point(points, complaint):
    with pytest.raises(InputError, match=complaint):
        point_table('trajectory', points, 2)


@pytest.mark.filterwarnings('error')
def test_points_a_nanosecond_apart_are_a_step():
    points = [(3.0 + k * 1e-9, [float(k)] * 2, [0, 0], [0, 0]) for k in (0, 1)]
    book = CommandBook(2)
    book.trajectory(5.0, ALL, *point_table('trajectory', points, 2), np.zeros(2))
    np.testing.assert_allclose(book.at(7.999), [0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(book.at(9.0), [1.0, 1.0])


def test_a_trajectory_without_stamp_starts_on_the_clock_of_the_samples():
    monitor = FaultMonitor(['a'])
    feed = MonitorFeed(monitor)
    for k in range(1, 101):
        # The samples' clock is a thousand seconds behind that of the arrivals.
        feed.joint_state(k * 10**7, k * 10**7 + 10**12, ['a'], [0.0])
    feed.trajectory(0, 10**12 + 10**9 + 5 * 10**6, ['a'], [(1.0, [1.0], [], [])])
    feed.joint_state(15 * 10**8, 10**12 + 15 * 10**8, ['a'], [0.0])
    assert monitor.states()[0].commanded_position == pytest.approx(0.495, abs=1e-9)


def test_samples_that_waited_in_a_queue_do_not_set_the_clock_of_commands_back():
    monitor = FaultMonitor(['a'])
    feed = MonitorFeed(monitor)
    for k in range(1, 101):
        # The last thirty are handed over together, some when the first of them should have come.
        feed.joint_state(k * 10**7, max(k, 71 + (k - 71) // 6) * 10**7, ['a'], [0.0])
    # It comes when 0.3 s of samples are still to be handed over.
    for k in range(101, 131):
        feed.joint_state(k * 10**7, 131 * 10**7, ['a'], [0.0])
    feed.trajectory(0, 131 * 10**7, ['a'], [(1.0, [1.0], [], [])])
    feed.joint_state(181 * 10**7, 181 * 10**7, ['a'], [0.0])
    assert monitor.states()[0].commanded_position == pytest.approx(0.5, abs=1e-9)


def test_a_clock_of_samples_that_was_set_back_is_that_of_commands():
    monitor = FaultMonitor(['a'])
    feed = MonitorFeed(monitor)
    for k in range(1, 101):
        feed.joint_state(10**12 + k * 10**7, k * 10**7, ['a'], [0.0])
    for k in range(101, 111):
        feed.joint_state(k * 10**7, k * 10**7, ['a'], [0.0])
    assert feed.on_sample_clock(111 * 10**7) == 111 * 10**7


def test_a_missed_trajectory_is_taken_from_the_report_of_its_plan():
    monitor = FaultMonitor(['a'])
    feed = MonitorFeed(monitor)

    def command(at):
        feed.joint_state(round(at * 1e9), round(at * 1e9), ['a'], [0.0])
        return monitor.states()[0].commanded_position

    feed.joint_state(10**9, 10**9, ['a'], [0.0])
    motion = [(0.0, [0.0], [], []), (1.0, [1.0], [], [])]
    back = [(0.0, [1.0], [], []), (1.0, [0.0], [], [])]
    # One that is over says nothing, and neither does one without a stamp or without points.
    feed.planned(10**7, 10**9, ['a'], [(0.0, [5.0], [], []), (0.1, [6.0], [], [])])
    feed.planned(0, 10**9, ['a'], motion)
    feed.planned(2 * 10**9, 10**9, ['a'], [])
    assert math.isnan(command(1.01))
    feed.planned(2 * 10**9, 10**9, ['a'], motion)
    assert command(2.5) == pytest.approx(0.5)
    # The one sent comes late after all; then the next one comes first, and its report is no news.
    feed.trajectory(2 * 10**9, 26 * 10**8, ['a'], motion)
    assert command(2.75) == pytest.approx(0.75)
    feed.trajectory(3 * 10**9, 3 * 10**9, ['a'], back)
    feed.planned(2 * 10**9, 3 * 10**9, ['a'], motion)
    assert command(3.25) == pytest.approx(0.75)


def test_a_driver_that_never_stamps_is_timed_by_arrival():
    monitor = FaultMonitor(['a'])
    feed = MonitorFeed(monitor)
    for k in range(1, 101):
        feed.joint_state(0, k * 10**7, ['a'], [0.001 * k])
    assert monitor.states()[0].state <= 1
    assert monitor.states()[0].position == pytest.approx(0.1)


def test_malformed_joint_states_are_refused_as_a_whole():
    monitor = FaultMonitor(['a', 'b'])
    feed = MonitorFeed(monitor)
    feed.joint_state(10**7, 10**7, ['a', 'b'], [0.1, 0.2])
    for names, arrays, complaint in (
        (['a', 'b'], ([0.5],), 'position: has 1 values for 2'),
        (['a', 'b'], ([0.5, 0.5], [1.0]), 'velocity: has 1'),
        (['a', 'b'], ([0.5, 0.5], [], [1.0, 2.0, 3.0]), 'effort: has 3'),
        (['a', 'a'], ([0.5, 0.6],), 'twice'),
    ):
        with pytest.raises(InputError, match=complaint):
            feed.joint_state(2 * 10**7, 2 * 10**7, names, *arrays)
    assert [report.position for report in monitor.states()] == [0.1, 0.2]
    assert feed.joint_state(3 * 10**7, 3 * 10**7, ['gripper'], [0.0]) == []
    assert feed.ignored == {'gripper'}
    with pytest.raises(InputError, match='must be finite'):
        feed.reference(3 * 10**7, 3 * 10**7, ['a'], [math.nan])
