"""Jerk-limited motion: closed forms, limits, no jumps, and splines that reproduce it."""

from __future__ import annotations

import numpy as np
import pytest
import ruckig

from ft_manip_ros.core.joint import FULL_TURN
from ft_manip_ros.core.planning import timing
from ft_manip_ros.core.planning.limits import MotionLimits, travel
from ft_manip_ros.core.planning.move_times import rest_to_rest_time, straight_time


def limits(n=2, *, reach=3.0, unlimited=False, velocity=1.0, acceleration=4.0, jerk=40.0):
    flags = np.full(n, unlimited)
    return MotionLimits(
        np.full(n, -reach),
        np.full(n, reach),
        flags,
        flags,
        np.full(n, velocity),
        np.full(n, acceleration),
        np.full(n, jerk),
    )


def test_long_move_takes_the_textbook_time():
    # Cruise at v, two ramps of v/a + a/j each shared between the ends.
    motion = timing.move_between(np.zeros(1), np.array([2.0]), limits(1), 0.1)
    assert motion.duration == pytest.approx(2.0 / 1.0 + 1.0 / 4.0 + 4.0 / 40.0, abs=1e-8)


def test_tiny_move_is_all_jerk():
    # Four equal jerk phases: way = 2 j t^3.
    motion = timing.move_between(np.zeros(1), np.array([1e-4]), limits(1), 0.1)
    assert motion.duration == pytest.approx(4.0 * (1e-4 / 80.0) ** (1.0 / 3.0), abs=1e-8)


@pytest.mark.parametrize('way', [1e-5, 1e-3, 0.02, 0.1, 0.5, 3.0])
@pytest.mark.parametrize(('v', 'a', 'j'), [(1.0, 4.0, 40.0), (0.2, 10.0, 20.0), (5.0, 2.0, 5.0)])
def test_closed_form_agrees_with_ruckig(way, v, a, j):
    motion = timing.move_between(
        np.zeros(1), np.array([way]), limits(1, velocity=v, acceleration=a, jerk=j), 1.0
    )
    assert rest_to_rest_time(way, v, a, j) == pytest.approx(motion.duration, abs=2e-9)


def test_straight_time_goes_the_short_way_round():
    a, b = np.array([3.0]), np.array([-3.0])
    bound = limits(1, reach=np.pi, unlimited=True)
    rates = (bound.velocity, bound.acceleration, bound.jerk)
    short = straight_time(a, b, np.array([True]), *rates)
    long = straight_time(a, b, np.array([False]), *rates)
    assert short == pytest.approx(rest_to_rest_time(FULL_TURN - 6.0, 1.0, 4.0, 40.0))
    assert long == pytest.approx(rest_to_rest_time(6.0, 1.0, 4.0, 40.0))
    assert travel(a, b, np.array([True]))[0] == pytest.approx(FULL_TURN - 6.0)


def test_joints_arrive_together_on_a_straight_line():
    motion = timing.move_between(np.zeros(2), np.array([1.0, -0.4]), limits(), 0.05)
    np.testing.assert_allclose(motion.positions[:, 1], -0.4 * motion.positions[:, 0], atol=1e-12)
    np.testing.assert_allclose(motion.positions[-1], [1.0, -0.4], atol=1e-12)


def test_no_way_is_no_motion():
    motion = timing.move_between(np.ones(2), np.ones(2), limits(), 0.1)
    assert motion.duration == 0.0
    assert motion.positions.shape == (1, 2)


def test_stop_keeps_the_start_velocity_and_brakes_in_the_textbook_way():
    v = np.array([0.8, -0.3])
    motion = timing.stop(np.zeros(2), v, limits(), 0.05)
    np.testing.assert_array_equal(motion.velocities[0], v)
    np.testing.assert_allclose(motion.velocities[-1], 0.0, atol=1e-12)
    # v (v/a + a/j) / 2 for 0.8 (acceleration is reached); v sqrt(v/j) for 0.3 (it is not).
    assert motion.positions[-1, 0] == pytest.approx(0.8 * (0.2 + 0.1) / 2.0, abs=1e-9)
    assert motion.positions[-1, 1] == pytest.approx(-0.3 * np.sqrt(0.3 / 40.0), abs=1e-9)


def test_flying_start_reaches_the_target_within_the_range():
    # Straight on to the target would overshoot the limit: the joint has to stop first.
    bound = limits(1, reach=1.0)
    q, v = np.array([0.8]), np.array([0.9])
    motion = timing.move_from(q, v, np.array([-0.5]), bound, bound, 0.05)
    _, high = timing.stopping_range(q, v, bound)
    assert motion.positions[-1, 0] == pytest.approx(-0.5, abs=1e-9)
    assert motion.positions.max() <= max(1.0, high[0]) + 1e-9
    assert timing.arrival_times(q, v, np.array([[-0.5]]), bound, bound) == pytest.approx(
        motion.duration, abs=1e-8
    )


def test_turning_point_within_constant_acceleration_is_sampled():
    # Ruckig's position_extrema misses this one; the hull of the check relies on it.
    bound = limits(1, reach=10.0, velocity=2.4173, acceleration=13.98892, jerk=139.8892)
    q, v = np.array([-2.5962]), np.array([-2.1444])
    motion = timing.move_from(q, v, np.array([-0.5762]), bound, bound, 0.05)
    turn = int(np.argmin(motion.positions[:, 0]))
    assert abs(motion.velocities[turn, 0]) < 1e-6
    assert motion.positions[turn, 0] < -2.86


def test_joined_motions_do_not_jump():
    bound = limits()
    first = timing.move_from(np.zeros(2), np.array([0.5, 0.1]), np.ones(2), bound, bound, 0.1)
    rest = timing.hold(first.positions[-1], 0.2)
    second = timing.move_between(first.positions[-1], np.zeros(2), bound, 0.1)
    motion = timing.joined([first, rest, second])
    assert np.all(np.diff(motion.times) > 0.0)
    assert motion.duration == pytest.approx(first.duration + 0.2 + second.duration, abs=1e-8)
    # Time stamps are whole nanoseconds.
    ticks = motion.times * 1e9
    np.testing.assert_allclose(ticks, np.round(ticks), atol=1e-3)
    step = np.abs(np.diff(motion.positions, axis=0)) / np.diff(motion.times)[:, None]
    assert step.max() <= 1.0 + 1e-6


@pytest.mark.parametrize('speed', [1e-3, 1e-4, 1e-6])
def test_motion_of_days_is_timed_like_any_other(speed):
    # Ruckig itself gives up beyond 7600 s.
    bound = limits(2, velocity=speed, acceleration=speed / 100.0, jerk=speed / 1000.0)
    q, v, target = np.array([0.1, -0.2]), np.array([0.5, -0.3]) * speed, np.array([1.9, 1.5])
    motion = timing.move_from(q, v, target, bound, bound, 0.05)
    assert motion.duration > 1.8 / speed
    assert motion.duration == pytest.approx(1.8 / speed, rel=0.3 if speed > 1e-4 else 0.1)
    np.testing.assert_allclose(motion.velocities[0], v)
    np.testing.assert_allclose(motion.positions[-1], target, atol=1e-9)
    np.testing.assert_allclose(motion.velocities[-1], 0.0, atol=1e-9 * speed)
    assert np.abs(motion.velocities).max() <= speed * (1.0 + 1e-9)
    assert np.abs(motion.accelerations).max() <= 0.01 * speed * (1.0 + 1e-9)
    # No more samples than anybody can use, at growing times.
    assert len(motion.times) < 3000
    assert np.all(np.diff(motion.times) > 0.0)
    straight = timing.move_between(q, target, bound, 0.05)
    assert straight.duration == pytest.approx(
        rest_to_rest_time(1.8, speed, speed / 100.0, speed / 1000.0), rel=1e-9
    )


def test_stop_of_hours_brakes_in_the_textbook_way():
    bound = limits(2, acceleration=1e-5, jerk=1e-6)
    motion = timing.stop(np.zeros(2), np.array([0.8, -0.3]), bound, 0.05)
    assert motion.duration == pytest.approx(0.8e5 + 10.0, rel=1e-9)
    assert motion.positions[-1, 0] == pytest.approx(0.8 * (0.8e5 + 10.0) / 2.0, rel=1e-9)
    assert motion.positions[-1, 1] == pytest.approx(-0.3 * (0.3e5 + 10.0) / 2.0, rel=1e-9)


@pytest.mark.parametrize('seed', range(5))
def test_samples_are_ruckigs_own_states(seed):
    rng = np.random.default_rng(seed)
    bound = limits(3, velocity=1.3, acceleration=3.7, jerk=31.0)
    q, v, target = rng.uniform(-1.0, 1.0, (3, 3))
    # The first joint is faster than it may be: its motion begins with a phase of braking.
    v[0] = 1.7
    given = ruckig.InputParameter(3)
    given.current_position, given.current_velocity = q.tolist(), v.tolist()
    given.target_position = target.tolist()
    given.max_velocity, given.max_acceleration = [1.3] * 3, [3.7] * 3
    given.max_jerk = [31.0] * 3
    wanted = ruckig.Trajectory(3)
    assert ruckig.Ruckig(3).calculate(given, wanted) == ruckig.Result.Working
    far = limits(3, reach=99.0, velocity=1.3, acceleration=3.7, jerk=31.0)
    for motion in (
        timing.move_from(q, v, target, far, bound, 0.07),
        timing.move_from(q, v, target, far, bound, 9.0),
    ):
        assert motion.duration == pytest.approx(wanted.duration, abs=2e-9)
        states = [wanted.at_time(time)[:3] for time in motion.times]
        sampled = np.stack([motion.positions, motion.velocities, motion.accelerations], axis=1)
        np.testing.assert_allclose(sampled, states, atol=1e-11)
