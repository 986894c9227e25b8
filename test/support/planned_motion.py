"""Random arms and tasks for planners, and an independent judge of the motions they make."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.joint import Axis, Joint
from ft_manip_ros.core.kinematics import fk


def random_rotation(rng):
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def random_arm(rng, n):
    """Joints of all kinds, with operating limits; now and then two axes that mimic some."""
    joints = []
    for i in range(n):
        prismatic = rng.random() < 0.15
        low, high = -rng.uniform(0.3, 3.1), rng.uniform(0.3, 3.1)
        if not prismatic and rng.random() < 0.2:
            low, high = -np.pi, np.pi
        elif not prismatic and rng.random() < 0.1:
            low, high = -2.0 * np.pi, 2.0 * np.pi
        joints.append(
            Joint(
                f'j{i}',
                low,
                high,
                operating_lower=low * rng.uniform(0.5, 1.0),
                operating_upper=high * rng.uniform(0.5, 1.0),
                velocity=rng.uniform(0.3, 4.0),
                acceleration=rng.uniform(0.5, 20.0),
                prismatic=prismatic,
            )
        )
    axes = [Axis(joint.name, i, prismatic=joint.prismatic) for i, joint in enumerate(joints)]
    for i in range(rng.choice([0, 0, 0, 2])):
        ratio = rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 1.5)
        follower = Axis(f'follower_{i}', int(rng.integers(n)), ratio, bool(rng.random() < 0.2))
        axes.insert(int(rng.integers(len(axes) + 1)), follower)
    rotations = np.array([random_rotation(rng) for _ in range(len(axes) + 1)])
    translations = rng.normal(size=(len(axes) + 1, 3)) * 0.4
    driven = tuple(axes) if len(axes) > n else ()
    return SerialChain('random', tuple(joints), rotations, translations, driven=driven)


def random_goals(rng, chain, count):
    """Poses, points, some with a free roll or on a straight line, some out of reach."""
    goals = []
    for _ in range(count):
        rotation, position = fk(chain, rng.uniform(chain.lower, chain.upper))
        kind = rng.integers(4)
        if kind == 0:
            goals.append(Goal(position, rotation))
        elif kind == 1:
            goals.append(Goal(position, rotation, free_axis=True))
        elif kind == 2:
            goals.append(Goal(position))
        else:
            goals.append(Goal(rng.normal(size=3) * 3.0))
    return [replace(goal, straight_line=bool(rng.random() < 0.3)) for goal in goals]


def dense_states(trajectory):
    """Positions and speeds along the spline, by finite evaluation of the controller's reading."""
    path = trajectory.path()
    times = np.linspace(0.0, trajectory.duration, 400)
    states = [path.sample(time) for time in times]
    return times, np.array([q for q, _ in states]), np.array([v for _, v in states])


def assert_safe(chain, trajectory, frozen, start, velocity, jerk_time):
    """Frozen joints are held, the others start as measured, keep their limits and end at rest.

    Parameters
    ----------
    start, velocity : shape (n,)
        Measured state.
    jerk_time
        Time (s) to build up full acceleration.
    """
    assert trajectory.joint_names == chain.joint_names
    assert np.all(np.diff(trajectory.times) > 0.0)
    lower = chain.lower if frozen else chain.operating_lower
    upper = chain.upper if frozen else chain.operating_upper
    _, q, v = dense_states(trajectory)
    turns = upper - lower >= 2.0 * np.pi - 1e-6
    endless = turns & (upper - lower < 2.0 * np.pi + 1e-3)
    # What a stop at full deceleration and jerk cannot avoid: bounded by stopping from v with
    # half the acceleration, and half again for building it up.
    unavoidable = velocity**2 / (2.0 * 0.95 * chain.acceleration) + np.abs(velocity) * jerk_time
    ahead = np.where(velocity > 0.0, unavoidable, 0.0)
    behind = np.where(velocity < 0.0, unavoidable, 0.0)
    for i, name in enumerate(chain.joint_names):
        if name in frozen:
            assert np.all(trajectory.positions[:, i] == frozen[name])
            assert not np.any(trajectory.velocities[:, i])
            assert not np.any(trajectory.accelerations[:, i])
            continue
        assert np.abs(v[:, i]).max() <= chain.velocity[i] * (1.0 + 1e-3)
        assert abs(trajectory.positions[0, i] - start[i]) < 1e-9
        assert abs(trajectory.velocities[0, i] - velocity[i]) < 1e-9
        if not endless[i]:
            assert q[:, i].max() <= max(upper[i], start[i] + ahead[i]) + 1e-6
            assert q[:, i].min() >= min(lower[i], start[i] - behind[i]) - 1e-6
    assert not np.any(trajectory.velocities[-1])
