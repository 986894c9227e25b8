"""The objective of equation 7: Table 3 at zero, worst angles against a dense cold grid."""

from dataclasses import replace

import numpy as np
import pytest

from ft_manip_ros.core.arm_file import load_dh
from ft_manip_ros.core.design.objective import Objective
from ft_manip_ros.core.design.problem import design_problem
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import DesignSpec
from ft_manip_ros.core.task_file import load_task
from support.dense_reach import worst_miss

TASK = load_task('paredis_eq_11')


def objective(seed=0, *, inner='', middle='', **settings):
    problem = design_problem(TASK, settings=DesignSettings(**settings))
    return Objective(problem, np.random.default_rng(seed), inner=inner, middle=middle)


def tables(count, seed=0):
    space = design_problem(TASK).space
    rng = np.random.default_rng(seed)
    return [space.sample(rng) for _ in range(count)]


@pytest.mark.parametrize(
    ('inner', 'middle'), [('newton', 'march'), ('newton', 'p_star'), ('hybrid', 'p_star')]
)
def test_table_3_has_no_penalty(inner, middle):
    value = objective(inner=inner, middle=middle, restarts=25)
    found = value.evaluate(value.problem.parameters(load_dh('paredis_table_3')))
    assert found.complete
    assert found.total == 0.0
    assert value.evaluations > 0


def test_marching_agrees_with_a_cold_grid():
    march = objective(middle='march', restarts=12)
    grid = objective(middle='grid', restarts=30)
    for p in tables(4):
        found, expected = march.evaluate(p).worst, grid.evaluate(p).worst
        np.testing.assert_array_equal(found > 0.0, expected > 0.0)
        # Out of reach both may stop at a local minimum, but seldom.
        close = np.abs(found - expected) <= 1e-4 * (1.0 + expected)
        assert close.mean() >= 0.8


def test_a_reported_worst_case_is_really_out_of_reach():
    problem = objective(restarts=12).problem
    p = tables(1, seed=3)[0]
    worst = objective(restarts=12).evaluate(p).worst
    n = problem.spec.dof
    d, a, alpha = p[:n], p[n : 2 * n], p[2 * n :]
    for goal in range(3):
        miss, _ = worst_miss(
            d, a, alpha, problem.limits.lower, problem.limits.upper,
            problem.goals.positions[goal], angles=5, starts=4,
        )  # fmt: skip
        # Bounded misses are larger than penalty misses, and zero together.
        assert (miss > 1e-5) == (worst[goal].max() > 0.0)


def test_p_star_misses_few_failing_angles():
    p_star = objective(middle='p_star', restarts=20)
    grid = objective(middle='grid', restarts=20, angles=65)
    failing, missed = 0, 0
    for p in tables(4, seed=5):
        expected = grid.evaluate(p).worst > 1e-6
        found = p_star.evaluate(p).worst > 0.0
        failing += expected.sum()
        missed += (expected & ~found).sum()
    assert failing > 20
    assert missed <= 0.1 * failing


def test_it_stops_once_it_exceeds_the_limit():
    value = objective()
    p = tables(1)[0]
    whole = value.evaluate(p)
    assert whole.total > 0.1
    spent = value.evaluations
    value.forget()
    part = value.evaluate(p, give_up=0.1)
    assert not part.complete
    assert 0.1 < part.total <= whole.total * 1.01
    assert value.evaluations - spent < spent


def test_forgetting_makes_the_value_repeatable():
    value = objective()
    first = value.evaluate(tables(1)[0])
    value.evaluate(tables(1, seed=1)[0])
    value.forget()
    again = value.evaluate(tables(1)[0])
    np.testing.assert_array_equal(first.worst, again.worst)


def test_order_2_freezes_every_pair():
    spec = DesignSpec(6, 2, -2.0, 2.0)
    problem = design_problem(TASK, spec, DesignSettings(angles=3))
    assert problem.sets.frozen.shape == (15, 2)
    found = Objective(problem, np.random.default_rng(0)).evaluate(
        problem.space.sample(np.random.default_rng(0))
    )
    assert found.worst.shape == (3, 15)
    for subset, frozen in enumerate(problem.sets.frozen):
        for joint in frozen:
            assert found.postures[0, subset, joint] in problem.sets.angles[joint]


def test_p_star_is_for_one_frozen_joint():
    problem = design_problem(TASK, DesignSpec(6, 2), DesignSettings(angles=3))
    with pytest.raises(InputError, match='p_star'):
        Objective(problem, np.random.default_rng(0), middle='p_star')


def test_a_grid_too_large_is_refused():
    with pytest.raises(InputError, match='angles'):
        design_problem(TASK, DesignSpec(8, 3), DesignSettings(angles=99))


def test_a_task_without_a_specification_is_refused():
    with pytest.raises(InputError, match='dof'):
        design_problem(replace(TASK, design=None))
