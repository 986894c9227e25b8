"""Random arms, faults and tasks: whatever leaves the planner is safe, judged independently."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.joint import Axis, Joint
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.planning.plan import Outcome, PlanStatus
from ft_manip_ros.core.planning.replan import plan_task
from ft_manip_ros.core.planning.settings import PlanSettings, Policy, Relaxation


def random_rotation(rng):
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def random_arm(rng, n):
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


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(2, 7),
    failures=st.integers(0, 2),
    count=st.integers(1, 4),
    policy=st.sampled_from(list(Policy)),
)
def test_random_arms_faults_and_tasks(seed, n, failures, count, policy):
    rng = np.random.default_rng(seed)
    chain = random_arm(rng, n)
    goals = random_goals(rng, chain, count)
    broken = rng.choice(n, size=min(failures, n), replace=False)
    # A lock happens where it happens, now and then outside the limits.
    frozen = {f'j{i}': float(rng.uniform(chain.lower[i] - 0.1, chain.upper[i])) for i in broken}
    start = rng.uniform(chain.operating_lower, chain.operating_upper)
    velocity = rng.uniform(-1.0, 1.0, n) * chain.velocity * rng.integers(2)
    accepted = frozenset(Relaxation) if rng.random() < 0.5 else frozenset()
    planning = PlanSettings(policy=policy, accepted=accepted, attempts=6, dwell=0.05)
    plan = plan_task(
        chain,
        list(enumerate(goals)),
        frozen=frozen,
        sigma={},
        start=start,
        start_velocity=velocity,
        settings=planning,
    )
    assert len(plan.outcomes) == count
    assert plan.status != PlanStatus.REFUSED, plan.reason
    trajectory = plan.trajectory
    assert trajectory is not None
    lower = chain.lower if frozen else chain.operating_lower
    upper = chain.upper if frozen else chain.operating_upper
    _, q, v = dense_states(trajectory)
    turns = upper - lower >= 2.0 * np.pi - 1e-6
    endless = turns & (upper - lower < 2.0 * np.pi + 1e-3)
    # What a stop at full deceleration and jerk cannot avoid: bounded by stopping from v with
    # half the acceleration, and half again for building it up.
    jerk_time = planning.jerk_time
    unavoidable = velocity**2 / (2.0 * 0.95 * chain.acceleration) + np.abs(velocity) * jerk_time
    ahead = np.where(velocity > 0.0, unavoidable, 0.0)
    behind = np.where(velocity < 0.0, unavoidable, 0.0)
    for i, name in enumerate(chain.joint_names):
        if name in frozen:
            assert np.all(trajectory.positions[:, i] == frozen[name])
            assert not np.any(trajectory.velocities[:, i])
            continue
        assert np.abs(v[:, i]).max() <= chain.velocity[i] * (1.0 + 1e-3)
        assert abs(trajectory.positions[0, i] - start[i]) < 1e-9
        assert abs(trajectory.velocities[0, i] - velocity[i]) < 1e-9
        if not endless[i]:
            assert q[:, i].max() <= max(upper[i], start[i] + ahead[i]) + 1e-6
            assert q[:, i].min() >= min(lower[i], start[i] - behind[i]) - 1e-6
    assert not np.any(trajectory.velocities[-1])
    for outcome in plan.outcomes:
        if outcome.outcome == Outcome.LOST:
            assert_lost(chain, frozen, outcome, rng)
        if outcome.has_posture:
            at, _ = trajectory.path().sample(outcome.arrival)
            rotation, position = fk(chain, at)
            goal = outcome.target
            assert np.linalg.norm(position - goal.position) <= goal.position_tolerance
            if goal.orientation is not None and not goal.free_axis:
                angle = np.arccos(
                    np.clip(0.5 * (np.trace(rotation.T @ goal.orientation) - 1.0), -1.0, 1.0)
                )
                assert angle <= goal.orientation_tolerance + 1e-6
            if goal.free_axis:
                cosine = rotation[:, 2] @ goal.orientation[:, 2]
                assert np.arccos(min(cosine, 1.0)) <= goal.orientation_tolerance + 1e-6


def assert_lost(chain, frozen, outcome, rng):
    """No sampled posture may come closer than the miss that was proved."""
    qs = rng.uniform(chain.lower, chain.upper, (2000, chain.n))
    for name, value in frozen.items():
        qs[:, chain.index(name)] = value
    _, positions = fk(chain, qs)
    nearest = np.linalg.norm(positions - outcome.goal.position, axis=1).min()
    assert nearest >= outcome.margin - 1e-9
