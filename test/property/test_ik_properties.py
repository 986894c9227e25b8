"""Bounded IK on random chains and real arms: what it returns is what it says, always."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.ik import solve_ik, solve_ik_batch
from ft_manip_ros.core.ik_settings import IkSettings
from ft_manip_ros.core.kinematics import fk
from support.chains import REAL_ARMS, random_chain, random_posture

KINDS = ('position', 'axis', 'pose')


def _goal(kind: str, rotation: np.ndarray, position: np.ndarray) -> Goal:
    if kind == 'position':
        return Goal(position)
    return Goal(position, rotation, free_axis=kind == 'axis')


def _errors(chain: SerialChain, q: np.ndarray, goal: Goal) -> tuple[float, float]:
    """Position and orientation error, by other formulas than the kernels'."""
    rotation, position = fk(chain, q)
    distance = float(np.linalg.norm(position - goal.position))
    if goal.orientation is None:
        return distance, 0.0
    if goal.free_axis:
        chord = float(np.linalg.norm(rotation[:, 2] - goal.orientation[:, 2]))
        return distance, 2.0 * float(np.arcsin(min(0.5 * chord, 1.0)))
    # The Frobenius distance of two rotations is sqrt(8) sin(angle / 2).
    chord = float(np.linalg.norm(rotation - goal.orientation)) / np.sqrt(8.0)
    return distance, 2.0 * float(np.arcsin(min(chord, 1.0)))


def _problems(
    chain: SerialChain, kind: str, count: int, rng: np.random.Generator
) -> tuple[list[Goal], np.ndarray, np.ndarray]:
    """Goals that a posture reaches, starts, and masks of up to two frozen joints."""
    goals, starts, frozen = [], [], []
    for _ in range(count):
        q, start = random_posture(chain, rng), random_posture(chain, rng)
        mask = np.zeros(chain.n, dtype=bool)
        mask[rng.choice(chain.n, size=int(rng.integers(0, min(3, chain.n))), replace=False)] = True
        # A lock may happen outside the limits.
        q[mask] += rng.normal(scale=0.2, size=mask.sum())
        start[mask] = q[mask]
        goals.append(_goal(kind, *fk(chain, q)))
        starts.append(start)
        frozen.append(mask)
    return goals, np.array(starts), np.array(frozen)


@pytest.mark.parametrize('kind', KINDS)
def test_results_are_within_limits_and_true(kind: str) -> None:
    rng = np.random.default_rng(21)
    settings = IkSettings(restarts=10)
    reached = 0
    for _ in range(60):
        chain = random_chain(rng)
        goals, starts, frozen = _problems(chain, kind, 5, rng)
        batch = solve_ik_batch(chain, goals, starts=starts, frozen=frozen, settings=settings)
        free = ~frozen
        assert (batch.q[frozen] == starts[frozen]).all()
        assert (batch.q >= chain.lower)[free].all()
        assert (batch.q <= chain.upper)[free].all()
        for k, goal in enumerate(goals):
            distance, angle = _errors(chain, batch.q[k], goal)
            assert distance == pytest.approx(batch.position_error[k], abs=1e-12)
            assert angle == pytest.approx(batch.orientation_error[k], abs=1e-7)
            within = distance <= 1e-6 and angle <= 1e-6 + 1e-9
            assert within == batch.converged[k] or abs(distance - 1e-6) < 1e-12
        reached += int(batch.converged.sum())
    # Every goal has a posture; few restarts must find most of them.
    assert reached >= 0.95 * 60 * 5


@pytest.mark.parametrize('kind', KINDS)
def test_the_answer_does_not_depend_on_threads_or_on_company(kind: str) -> None:
    rng = np.random.default_rng(22)
    chain = load_arm('paredis_table_2')
    goals, starts, frozen = _problems(chain, kind, 1100, rng)
    settings = IkSettings(seed=5, restarts=3)
    one = solve_ik_batch(chain, goals, starts=starts, frozen=frozen, settings=settings)
    four = solve_ik_batch(chain, goals, starts=starts, frozen=frozen, settings=settings, threads=4)
    few = solve_ik_batch(chain, goals[:7], starts=starts[:7], frozen=frozen[:7], settings=settings)
    assert (one.q == four.q).all()
    assert (one.iterations == four.iterations).all()
    assert (one.q[:7] == few.q).all()


@pytest.mark.parametrize('kind', KINDS)
def test_a_mask_is_the_same_as_a_rod(kind: str) -> None:
    rng = np.random.default_rng(23)
    for _ in range(20):
        chain = random_chain(rng, joints=6)
        q = random_posture(chain, rng)
        goal = _goal(kind, *fk(chain, q))
        name = chain.joint_names[int(rng.integers(6))]
        rod = chain.freeze({name: q[chain.index(name)]})
        kept = [chain.index(other) for other in rod.joint_names]
        start = random_posture(chain, rng)
        start[chain.index(name)] = q[chain.index(name)]
        mask = np.array([other == name for other in chain.joint_names])
        settings = IkSettings(restarts=0)
        masked = solve_ik_batch(chain, [goal], starts=start, frozen=mask, settings=settings)
        alone = solve_ik(rod, goal, start=start[kept], settings=settings)
        assert bool(masked.converged[0]) == alone.converged
        assert masked.q[0][kept] == pytest.approx(alone.q, abs=1e-6)


@pytest.mark.parametrize('arm', REAL_ARMS)
def test_real_arms_reach_what_they_can_reach(arm: str) -> None:
    url, base, tip, _ = REAL_ARMS[arm]
    chain = load_arm(url, base=base, tip=tip)
    rng = np.random.default_rng(24)
    for kind in ('position', 'pose') if chain.n >= 6 else ('position',):
        qs = np.array([random_posture(chain, rng) for _ in range(100)])
        goals = [_goal(kind, *fk(chain, q)) for q in qs]
        batch = solve_ik_batch(chain, goals)
        assert batch.converged.mean() >= 0.99, kind


def test_a_start_near_an_answer_leads_to_it() -> None:
    rng = np.random.default_rng(25)
    chain = load_arm('paredis_table_3')
    for _ in range(100):
        q = 0.9 * random_posture(chain, rng)
        rod = chain.freeze({'joint_1': q[0], 'joint_5': q[4]})
        goal = Goal(fk(chain, q)[1])
        start = q[1:4] + rng.uniform(-1e-3, 1e-3, 3)
        result = solve_ik(rod, goal, start=start)
        # Singular postures, where answers meet, are the exception.
        if np.linalg.svd(_linear(rod, q[1:4]), compute_uv=False)[-1] > 0.05:
            assert result.converged
            assert result.restarts == 0
            assert np.abs(result.q - q[1:4]).max() < 0.05


def _linear(chain: SerialChain, q: np.ndarray) -> np.ndarray:
    step = 1e-6
    columns = [
        (fk(chain, q + step * unit)[1] - fk(chain, q - step * unit)[1]) / (2 * step)
        for unit in np.eye(chain.n)
    ]
    return np.array(columns).T


def test_out_of_reach_ends_in_the_minimum_that_scipy_finds() -> None:
    rng = np.random.default_rng(26)
    chain = load_arm('paredis_table_3').freeze({'joint_2': 0.4})
    for _ in range(10):
        direction = rng.normal(size=3)
        goal = Goal(6.0 * direction / np.linalg.norm(direction))
        result = solve_ik(chain, goal)
        assert not result.converged
        assert 'misses by' in result.reason
        assert 'unreachable' not in result.reason
        best = min(
            least_squares(
                lambda q, goal=goal: (
                    fk(chain, np.clip(q, chain.lower, chain.upper))[1] - goal.position
                ),
                rng.uniform(chain.lower, chain.upper),
                bounds=(chain.lower, chain.upper),
                xtol=1e-12,
                ftol=1e-14,
                gtol=1e-12,
            ).cost
            for _ in range(12)
        )
        assert result.residual <= np.sqrt(2.0 * best) + 1e-6
        assert np.linalg.norm(fk(chain, result.q)[1] - goal.position) == pytest.approx(
            result.residual, abs=1e-12
        )


def test_goals_on_the_boundary_of_the_reach_are_reached() -> None:
    # Stretched out: the Jacobian is singular at the only answer, where steps converge slowly.
    chain = load_arm('planar_3r')
    result = solve_ik(chain, Goal([3.0, 0.0, 0.0]), start=[0.4, -0.3, 0.2])
    assert result.converged
    assert solve_ik(chain, Goal([0.0, 0.0, 0.1])).position_error == pytest.approx(0.1, abs=1e-9)


def test_more_than_a_turn_stays_inside_the_limits_and_near_the_start() -> None:
    url, base, tip, _ = REAL_ARMS['ur5']
    chain = load_arm(url, base=base, tip=tip)
    rng = np.random.default_rng(27)
    for _ in range(100):
        q = rng.uniform(chain.lower, chain.upper)
        start = np.clip(q + rng.uniform(-0.01, 0.01, 6), chain.lower, chain.upper)
        result = solve_ik(chain, _goal('pose', *fk(chain, q)), start=start)
        assert result.converged
        assert (result.q >= chain.lower).all()
        assert (result.q <= chain.upper).all()
