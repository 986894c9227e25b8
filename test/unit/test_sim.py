"""The simulated arm against closed forms: servo lag, limits, locks, determinism."""

import math

import numpy as np
import pytest

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.joint import Joint
from ft_manip_ros.core.joint_path import JointPath
from ft_manip_ros.core.sim import STEP, SimSettings, SimulatedArm

NAMES = ('shoulder', 'elbow')
QUIET = SimSettings(noise=0.0, velocity_noise=0.0, resolution=0.0)


def two_joints(**limits):
    joints = tuple(Joint(name, **limits) for name in NAMES)
    return SerialChain('two', joints, np.array([np.eye(3)] * 3), np.zeros((3, 3)))


def ramp(speed, duration):
    """Both joints at constant speed from 0, told by velocities too."""
    times = np.array([0.0, duration])
    positions = np.array([[0.0, 0.0], [speed * duration] * 2])
    return JointPath(NAMES, times, positions, np.full((2, 2), speed))


def test_lag_of_a_critically_damped_servo():
    arm = SimulatedArm(two_joints(velocity=2.0, acceleration=1e4), QUIET)
    arm.follow(ramp(1.0, 3.0))
    arm.advance(2.0)
    lag = 2.0 - arm.position
    # Steady lag of w^2 / (s + w)^2 behind a ramp: 2 / w.
    np.testing.assert_allclose(lag, 2.0 / QUIET.servo_frequency, atol=2 * STEP)
    np.testing.assert_allclose(arm.velocity, 1.0, atol=1e-6)


def test_step_response_matches_the_closed_form():
    arm = SimulatedArm(two_joints(velocity=1e3, acceleration=1e6), QUIET)
    arm.follow(JointPath(NAMES, np.array([0.0]), np.array([[0.1, -0.1]])))
    w = QUIET.servo_frequency
    for time in (0.01, 0.05, 0.1, 0.3):
        arm.advance(time)
        expected = 0.1 * (1.0 - np.exp(-w * time) * (1.0 + w * time))
        np.testing.assert_allclose(arm.position, [expected, -expected], atol=4e-3)
    np.testing.assert_allclose(arm.position, [0.1, -0.1], atol=1e-5)


def test_speed_and_acceleration_stay_within_the_limits():
    chain = two_joints(velocity=0.5, acceleration=3.0)
    arm = SimulatedArm(chain, QUIET)
    arm.follow(JointPath(NAMES, np.array([0.0]), np.array([[2.0, -2.0]])))
    before = arm.velocity
    for k in range(1, 6000):
        arm.advance(k * STEP)
        assert np.all(np.abs(arm.velocity) <= chain.velocity + 1e-12)
        change = np.abs(arm.velocity - before) / STEP
        assert np.all(change <= QUIET.acceleration_reserve * chain.acceleration + 1e-9)
        before = arm.velocity
    np.testing.assert_allclose(arm.position, [2.0, -2.0], atol=1e-6)


def test_a_smooth_path_is_never_outrun():
    """No peak speed of the motion exceeds the commanded one."""
    arm = SimulatedArm(two_joints(velocity=10.0, acceleration=1e3), QUIET)
    times = np.linspace(0.0, 2.0, 21)
    positions = np.outer(np.sin(np.pi * times) ** 2, [1.0, -0.5])
    velocities = np.outer(np.pi * np.sin(2 * np.pi * times), [1.0, -0.5])
    accelerations = np.outer(2 * np.pi**2 * np.cos(2 * np.pi * times), [1.0, -0.5])
    arm.follow(JointPath(NAMES, times, positions, velocities, accelerations))
    fastest = np.zeros(2)
    for k in range(1, 2500):
        arm.advance(k * STEP)
        fastest = np.maximum(fastest, np.abs(arm.velocity))
    assert np.all(fastest <= np.pi * np.array([1.0, 0.5]) * 1.001)
    assert np.all(fastest >= np.pi * np.array([1.0, 0.5]) * 0.9)


def test_lock_mid_motion_stops_one_joint_only():
    arm = SimulatedArm(two_joints(velocity=2.0), QUIET)
    arm.follow(ramp(1.0, 2.0))
    arm.lock('elbow', 1.0)
    arm.advance(0.9)
    assert arm.velocity[1] > 0.5
    arm.advance(1.0)
    stuck = arm.position[1]
    assert arm.locked_joints == {'elbow': stuck}
    arm.advance(4.0)
    assert arm.position[1] == stuck
    assert arm.velocity[1] == 0.0
    np.testing.assert_allclose(arm.position[0], 2.0, atol=1e-6)


def test_release_goes_back_to_the_command():
    arm = SimulatedArm(two_joints(velocity=2.0), QUIET)
    arm.follow(ramp(1.0, 1.0))
    arm.lock('elbow', 0.5)
    arm.release('elbow', 2.0)
    arm.advance(6.0)
    assert not arm.locked_joints
    np.testing.assert_allclose(arm.position, 1.0, atol=1e-6)


def test_how_often_the_arm_is_asked_does_not_matter():
    coarse = SimulatedArm(two_joints(velocity=2.0), QUIET)
    fine = SimulatedArm(two_joints(velocity=2.0), QUIET)
    for arm in (coarse, fine):
        arm.follow(ramp(1.0, 2.0))
        arm.lock('shoulder', 0.7654)
    coarse.advance(1.5)
    for k in range(1501):
        fine.advance(k * 1e-3)
    np.testing.assert_array_equal(coarse.position, fine.position)


def test_same_seed_same_readings_and_noise_of_the_stated_size():
    settings = SimSettings(noise=1e-3, velocity_noise=0.01, resolution=0.0, seed=7)
    a, b = (SimulatedArm(two_joints(), settings) for _ in range(2))
    readings = np.array([np.concatenate(a.measure()) for _ in range(4000)])
    again = np.array([np.concatenate(b.measure()) for _ in range(4000)])
    np.testing.assert_array_equal(readings, again)
    np.testing.assert_allclose(readings.std(axis=0), [1e-3, 1e-3, 0.01, 0.01], rtol=0.05)


def test_readings_are_multiples_of_the_resolution():
    settings = SimSettings(noise=1e-3, resolution=1e-3)
    arm = SimulatedArm(two_joints(), settings, start=np.array([0.12345, -0.3]))
    position, _ = arm.measure()
    np.testing.assert_allclose(position / 1e-3, np.round(position / 1e-3), atol=1e-9)


def test_stops_at_a_mechanical_limit_it_is_driven_over():
    arm = SimulatedArm(two_joints(lower=-1.0, upper=1.0, velocity=2.0), QUIET)
    with pytest.raises(InputError, match=r'points\[1\]\.positions of shoulder.*\[-1, 1\]'):
        arm.follow(ramp(1.0, 1.5))
    assert np.all(arm.position == 0.0)


def test_a_path_a_little_over_a_limit_is_followed_to_the_mechanical_stop():
    arm = SimulatedArm(two_joints(lower=-1.0, upper=1.0, velocity=2.0), QUIET)
    arm.follow(ramp(1.0, 1.03))
    arm.advance(2.0)
    assert arm.position[0] == 1.0
    assert arm.velocity[0] == 0.0


def test_default_start_is_within_limits_that_exclude_zero():
    arm = SimulatedArm(two_joints(lower=-3.0, upper=-1.0), QUIET)
    np.testing.assert_allclose(arm.position, -2.0)


def test_a_path_that_starts_later_begins_where_the_arm_stands():
    arm = SimulatedArm(two_joints(velocity=2.0), QUIET, start=np.array([0.5, 0.5]))
    arm.follow(JointPath(NAMES, np.array([1.0]), np.array([[1.0, 0.0]])))
    arm.advance(0.5)
    # Linear, as only positions are given: half way, less the lag of the servo.
    np.testing.assert_allclose(arm.position, [0.75, 0.25], atol=0.5 * 2.5 / 60.0)
    arm.advance(2.0)
    np.testing.assert_allclose(arm.position, [1.0, 0.0], atol=1e-6)


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'noise': float('nan')}, 'noise'),
        ({'servo_frequency': 0.0}, 'servo_frequency'),
        ({'servo_frequency': 1e6}, 'at most 500'),
        ({'resolution': -1.0}, 'resolution'),
        ({'acceleration_reserve': 0.5}, 'at least 1'),
    ],
)
def test_unusable_settings_are_named(change, message):
    with pytest.raises(InputError, match=message):
        SimSettings(**change)


def test_unknown_joint_names_the_known_ones():
    arm = SimulatedArm(two_joints(), QUIET)
    with pytest.raises(InputError, match='shoulder, elbow'):
        arm.lock('wrist', 0.0)


def test_a_sluggish_joint_falls_behind_and_catches_up_when_released():
    lag = 0.2
    arm = SimulatedArm(two_joints(velocity=5.0), QUIET)
    arm.follow(ramp(1.0, 10.0))
    arm.slow('elbow', 1.0, lag)
    arm.advance(0.99)
    np.testing.assert_allclose(arm.position[0], arm.position[1], atol=1e-9)
    arm.advance(2.0)
    # A tenth of a second a second.
    np.testing.assert_allclose(arm.position[0] - arm.position[1], 0.1, atol=5e-3)
    arm.advance(5.0)
    np.testing.assert_allclose(arm.position[0] - arm.position[1], lag, atol=2e-3)
    assert not arm.locked_joints
    arm.release('elbow', 5.0)
    arm.advance(9.0)
    np.testing.assert_allclose(arm.position[0], arm.position[1], atol=2e-3)


@pytest.mark.parametrize('lag', [0.0, -0.1, 1.5, math.nan])
def test_a_lag_that_no_joint_has_is_refused(lag):
    arm = SimulatedArm(two_joints(), QUIET)
    with pytest.raises(InputError, match='lag'):
        arm.slow('elbow', 0.0, lag)
