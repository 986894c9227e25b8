"""IK settings, results and kernels: what is refused, random numbers, wrapping."""

from __future__ import annotations

import numpy as np
import pytest

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.ik import solve_ik, solve_ik_batch
from ft_manip_ros.core.ik_settings import IkSettings
from ft_manip_ros.core.ik_types import splitmix, uniform, wrap_near
from ft_manip_ros.core.kinematics import fk

# The published outputs of splitmix64 for seed 1234567 (Vigna), upper 53 bits as a fraction.
SPLITMIX_1234567 = [6457827717110365317, 3203168211198807973, 9817491932198370423]


def test_random_numbers_are_splitmix64() -> None:
    state = np.uint64(1234567)
    for expected in SPLITMIX_1234567:
        state = np.uint64(splitmix(state))
        assert uniform(state) == (expected >> 11) * 2.0**-53


def test_random_numbers_fill_the_unit_interval() -> None:
    state, values = np.uint64(0), []
    for _ in range(4000):
        state = np.uint64(splitmix(state))
        values.append(uniform(state))
    counts, _ = np.histogram(values, bins=10, range=(0.0, 1.0))
    assert counts.sum() == 4000
    # Chi-squared with 9 degrees of freedom: 27.9 is passed once in a thousand.
    assert ((counts - 400.0) ** 2 / 400.0).sum() < 27.9


@pytest.mark.parametrize(
    ('value', 'near', 'lower', 'upper', 'expected'),
    [
        (4.0, 0.0, -np.pi, np.pi, 4.0 - 2 * np.pi),
        (0.5, 6.0, -2 * np.pi, 2 * np.pi, 0.5),
        (0.1, 6.0, -2 * np.pi, 2 * np.pi, 0.1),
        (-0.5, 5.0, -2 * np.pi, 2 * np.pi, 2 * np.pi - 0.5),
        (20.0, 3.0, -np.pi, np.pi, 20.0 - 6 * np.pi),
        (-20.0, -3.0, -np.pi, np.pi, -20.0 + 6 * np.pi),
        (1.0, 7.0, 0.0, 2 * np.pi, 1.0),
    ],
)
def test_wrapping(value: float, near: float, lower: float, upper: float, expected: float) -> None:
    assert wrap_near(value, near, lower, upper) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    'fields',
    [
        {'tolerance': 0.0},
        {'tolerance': np.nan},
        {'orientation_tolerance': -1.0},
        {'orientation_weight': np.inf},
        {'max_iterations': 0},
        {'restarts': -1},
        {'seed': -1},
    ],
)
def test_settings_refuse_what_cannot_be(fields: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(fields))):
        IkSettings(**fields)  # type: ignore[arg-type]


def test_malformed_arrays_are_refused() -> None:
    chain = load_arm('planar_3r')
    goal = Goal([1.0, 0.0, 0.0])
    with pytest.raises(InputError, match='shape'):
        solve_ik(chain, goal, start=[0.0, 0.0])
    with pytest.raises(InputError, match='NaN'):
        solve_ik(chain, goal, start=[0.0, np.nan, 0.0])
    with pytest.raises(InputError, match='starts: has shape'):
        solve_ik_batch(chain, [goal, goal], starts=np.zeros((3, 3)))
    with pytest.raises(InputError, match='starts: contain NaN'):
        solve_ik_batch(chain, [goal], starts=np.full(3, np.nan))
    with pytest.raises(InputError, match='frozen: has shape'):
        solve_ik_batch(chain, [goal], frozen=np.zeros(2, dtype=bool))
    with pytest.raises(InputError, match='threads'):
        solve_ik_batch(chain, [goal], threads=0)


def test_no_goals_give_no_results() -> None:
    batch = solve_ik_batch(load_arm('planar_3r'), [])
    assert batch.q.shape == (0, 3)


def test_inputs_are_left_alone_and_seeds_repeat() -> None:
    chain = load_arm('paredis_table_3')
    start = np.full(5, 9.0)
    goal = Goal([0.5, 0.0, 0.5])
    first = solve_ik(chain, goal, start=start, settings=IkSettings(seed=3))
    again = solve_ik(chain, goal, start=start, settings=IkSettings(seed=3))
    assert (start == 9.0).all()
    assert first.converged
    assert (first.q == again.q).all()


def test_everything_frozen_says_how_far_off_it_stands() -> None:
    chain = load_arm('planar_3r').freeze({'joint_1': 0.0, 'joint_2': 0.0, 'joint_3': 0.0})
    result = solve_ik(chain, Goal([1.0, 0.0, 0.0]))
    assert not result.converged
    assert result.position_error == pytest.approx(2.0)
    assert solve_ik(chain, Goal([3.0, 0.0, 0.0])).converged


def test_half_a_turn_off_is_no_trap() -> None:
    # The tool must turn right round about an axis that the start gives no hint of.
    chain = load_arm('paredis_table_2')
    start = np.full(8, 0.3)
    rotation, position = fk(chain, start)
    for flip in ([1, -1, -1], [-1, 1, -1], [-1, -1, 1]):
        goal = Goal(position, rotation @ np.diag(np.array(flip, dtype=float)))
        assert solve_ik(chain, goal, start=start).converged
        assert solve_ik(chain, Goal(position, goal.orientation, True), start=start).converged


@pytest.mark.parametrize('metres', [1e3, 1e9, 1e150, 1e155, 1.7e308])
@pytest.mark.parametrize('arm', ['paredis_table_1', 'paredis_table_3'])
def test_absurdly_far_goals_end_with_a_posture_within_limits(arm: str, metres: float) -> None:
    chain = load_arm(arm)
    for orientation in (None, np.eye(3)):
        result = solve_ik(chain, Goal([metres, 0.0, -metres], orientation))
        assert not result.converged
        assert (result.q >= chain.lower).all()
        assert (result.q <= chain.upper).all()
        assert result.position_error > 0.9 * metres
