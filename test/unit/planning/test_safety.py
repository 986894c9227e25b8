"""The gate: a good trajectory passes, and each single defect is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.joint import Joint
from ft_manip_ros.core.planning import hulls, timing
from ft_manip_ros.core.planning.limits import motion_limits
from ft_manip_ros.core.planning.safety import check_trajectory
from ft_manip_ros.core.planning.trajectory import Trajectory

JOINTS = tuple(Joint(name, -1.0, 1.0, velocity=1.0, acceleration=4.0) for name in 'abc')
CHAIN = SerialChain('arm', JOINTS, np.tile(np.eye(3), (4, 1, 1)), np.ones((4, 3)))
LIMITS = motion_limits(CHAIN, operating=False, jerk_time=0.1)
START = np.array([0.1, 0.5, -0.2])
FROZEN = {'b': 0.5}


def good():
    motion = timing.move_between(START, np.array([0.9, 0.5, -0.9]), LIMITS, 0.1)
    return Trajectory(
        CHAIN.joint_names, motion.times, motion.positions, motion.velocities, motion.accelerations
    )


def problems(trajectory, **changes):
    given = {'frozen': FROZEN, 'start': START, 'start_velocity': np.zeros(3), **changes}
    return check_trajectory(CHAIN, trajectory, LIMITS, **given)


def altered(field, row, joint, value):
    trajectory = good()
    values = getattr(trajectory, field).copy()
    values[row, joint] = value
    return replace(trajectory, **{field: values})


def test_good_trajectory_passes():
    assert problems(good()) == ()


def test_standing_still_passes():
    zero = np.zeros((1, 3))
    assert problems(Trajectory(CHAIN.joint_names, np.zeros(1), START[None, :], zero, zero)) == ()


@pytest.mark.parametrize(
    ('trajectory', 'words'),
    [
        (altered('positions', 4, 1, 0.5001), "frozen joint 'b' is commanded away"),
        (altered('velocities', 4, 1, 1e-3), "frozen joint 'b' is commanded to move"),
        (altered('accelerations', 4, 1, 1e-3), "frozen joint 'b' is commanded to move"),
        (altered('positions', 4, 0, np.nan), 'NaN'),
        (altered('velocities', 4, 2, np.inf), 'NaN'),
        (altered('velocities', 5, 0, 1.3), "'a' leaves its velocity range"),
        (altered('accelerations', 5, 2, -9.0), "'c' leaves its acceleration range"),
        (altered('positions', -1, 0, 1.2), "'a' leaves its position range"),
        (altered('positions', 0, 0, 0.2), "'a' starts with position 0.2"),
        (altered('velocities', 0, 2, 0.01), "'c' starts with velocity 0.01"),
        (altered('velocities', -1, 2, 0.01), 'does not end at rest'),
        (replace(good(), joint_names=('a', 'c', 'b')), 'joint names'),
        (replace(good(), times=good().times[::-1].copy()), 'strictly'),
        (replace(good(), times=np.zeros(len(good().times))), 'strictly'),
        (replace(good(), times=good().times - 1.0), 'strictly'),
    ],
)
def test_each_defect_is_named(trajectory, words):
    found = problems(trajectory)
    assert found
    assert any(words in problem for problem in found), found


def test_defect_between_points_is_seen():
    # Both end states are harmless; the quintic through them swings out in between.
    times = np.array([0.0, 1.0])
    positions = np.array([[0.9, 0.5, 0.0], [0.9, 0.5, 0.0]])
    velocities = np.array([[0.9, 0.0, 0.0], [-0.9, 0.0, 0.0]])
    end = Trajectory(CHAIN.joint_names, times, positions, velocities, np.zeros((2, 3)))
    found = problems(end, start=positions[0], start_velocity=velocities[0])
    assert any("'a' leaves its position range" in problem for problem in found)


def test_frozen_joint_outside_its_limits_is_held():
    frozen = {'b': 1.3}
    trajectory = good()
    positions = trajectory.positions.copy()
    positions[:, 1] = 1.3
    start = START.copy()
    start[1] = 1.3
    held = replace(trajectory, positions=positions)
    assert problems(held, frozen=frozen, start=start) == ()
    # The same joint, healthy, would have to come back inside.
    assert problems(held, frozen={}, start=np.array([0.1, 0.4, -0.2]))


def test_unavoidable_overshoot_is_allowed_and_no_more():
    start, speed = np.array([0.95, 0.5, -0.2]), np.array([0.9, 0.0, 0.0])
    halt = timing.stop(start, speed, LIMITS, 0.05)
    held = Trajectory(
        CHAIN.joint_names, halt.times, halt.positions, halt.velocities, halt.accelerations
    )
    assert halt.positions[-1, 0] > 1.0
    assert problems(held, start=start, start_velocity=speed) == ()
    lazy = timing.stop(start, speed, LIMITS.scaled(0.7), 0.05)
    late = Trajectory(
        CHAIN.joint_names, lazy.times, lazy.positions, lazy.velocities, lazy.accelerations
    )
    found = problems(late, start=start, start_velocity=speed)
    assert any("'a' leaves its position range" in problem for problem in found)


def test_unknown_frozen_joint_is_named():
    assert any("'d' is not listed" in p for p in problems(good(), frozen={'d': 0.0, **FROZEN}))


def test_compiled_hulls_say_what_the_arrays_say():
    rng = np.random.default_rng(3)
    said = []
    for _ in range(300):
        times = np.cumsum(rng.uniform(0.01, 0.5, 6))
        q, v, a = rng.normal(size=(3, 6, 2))
        steps = np.diff(times)[:, None]
        ends = (q[:-1], v[:-1], a[:-1], q[1:], v[1:], a[1:])
        ranges = []
        for hull in (hulls.hull_positions, hulls.hull_velocities, hulls.hull_accelerations):
            points = hull(steps, *ends).reshape(-1, 2)
            ranges.append([points.min(axis=0) - 1e-9, points.max(axis=0) + 1e-9])
        tight = rng.integers(3), rng.integers(2), rng.integers(2)
        wanted = bool(rng.integers(2))
        if not wanted:
            kind, end, joint = tight
            ranges[kind][end][joint] += 2e-9 if end == 0 else -2e-9
        said.append(hulls.all_inside(times, q, v, a, *map(tuple, ranges)) == wanted)
    assert all(said)
