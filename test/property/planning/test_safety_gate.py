"""Random arms, faults and tasks: whatever leaves the planner is safe, judged independently."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.planning.plan import Outcome, PlanStatus
from ft_manip_ros.core.planning.replan import plan_task
from ft_manip_ros.core.planning.settings import PlanSettings, Policy, Relaxation
from support.planned_motion import assert_safe, random_arm, random_goals


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
    assert_safe(chain, trajectory, frozen, start, velocity, planning.jerk_time)
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
