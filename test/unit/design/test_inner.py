"""The inner minimisation against scipy, in reach and out of reach."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from ft_manip_ros.core.design.dh_kernels import (
    ORIGIN,
    POSITION,
    Goals,
    Limits,
    make_rows,
    make_work,
)
from ft_manip_ros.core.design.inner import BOUNDED_LM, INNER_METHODS, minimise
from ft_manip_ros.core.design.penalty import derivatives
from support.dense_reach import dh_frame

N = 5
FREE = np.array([0, 1, 3, 4])
STARTS = 15
BOUND = np.full(N, 2.0)
LIMITS = Limits(-BOUND, BOUND, np.ones(N, dtype=bool), -BOUND, BOUND)


def problems(scale, count=8):
    rng = np.random.default_rng(7)
    for _ in range(count):
        table = rng.uniform(-1, 1, N), rng.uniform(0.2, 1, N), rng.uniform(-np.pi, np.pi, N)
        yield table, scale * rng.uniform(-1, 1, 3), rng.uniform(-2, 2, (STARTS, N))


def goals(point):
    return Goals(point[None].copy(), np.eye(3)[None].copy(), np.array([POSITION]))


def best_of(method, table, point, starts):
    work, rows = make_work(N), make_rows(*table)
    values = []
    for start in starts:
        q = start.copy()
        value, evaluations = minimise(
            method, rows, goals(point), 0, LIMITS, FREE, q, 1e-16, 200, work
        )
        assert evaluations >= 1
        assert q[2] == start[2]
        values.append((value, tuple(q)))
    return min(values)


def scipy_best(table, point, starts, bounded):
    def residual(x, frozen):
        q = frozen.copy()
        q[FREE] = x
        reach = dh_frame(*table, q)[:3, 3] - point
        if bounded:
            return reach
        over = np.maximum(0, q - BOUND) + np.maximum(0, -BOUND - q)
        return np.concatenate([reach, over[FREE]])

    bounds = (-BOUND[FREE], BOUND[FREE]) if bounded else (-np.inf, np.inf)
    found = [
        least_squares(
            residual, s[FREE], args=(s,), bounds=bounds, xtol=1e-12, ftol=1e-12, gtol=1e-12
        )
        for s in starts
    ]
    return min(2.0 * result.cost for result in found)


@pytest.mark.parametrize('method', range(len(INNER_METHODS)), ids=INNER_METHODS)
@pytest.mark.parametrize('scale', [0.4, 4.0], ids=['in_reach', 'out_of_reach'])
def test_the_best_of_many_starts_is_scipys(method, scale):
    for table, point, starts in problems(scale):
        # One frozen angle for all starts, so that both face one problem.
        starts[:, 2] = starts[0, 2]
        value, q = best_of(method, table, point, starts)
        expected = scipy_best(table, point, starts, method == BOUNDED_LM)
        assert value == pytest.approx(expected, rel=1e-4, abs=1e-10)
        reach = np.sum((dh_frame(*table, q)[:3, 3] - point) ** 2)
        over = np.maximum(0, np.abs(np.array(q)) - BOUND)[FREE]
        assert value == pytest.approx(reach + np.sum(over**2), rel=1e-9, abs=1e-15)
        if method == BOUNDED_LM:
            assert not over.any()


@pytest.mark.parametrize('method', [0, 1, 2], ids=INNER_METHODS[:3])
def test_out_of_reach_it_ends_at_a_stationary_point(method):
    for table, point, starts in problems(4.0):
        work, rows, q = make_work(N), make_rows(*table), starts[0].copy()
        value, _ = minimise(method, rows, goals(point), 0, LIMITS, FREE, q, 1e-16, 500, work)
        # The scratch memory describes q, as the callers rely on.
        np.testing.assert_allclose(work[ORIGIN, N, :3], dh_frame(*table, q)[:3, 3], atol=1e-12)
        assert derivatives(goals(point), 0, FREE, False, work) <= 1e-2 * np.sqrt(value) + 1e-9


def test_the_second_derivatives_pay_out_of_reach():
    spent = []
    for method in range(3):
        count = 0
        for table, point, starts in problems(4.0):
            work, rows = make_work(N), make_rows(*table)
            for start in starts:
                q = start.copy()
                _, used = minimise(
                    method, rows, goals(point), 0, LIMITS, FREE, q, 1e-16, 200, work
                )
                count += used
        spent.append(count)
    newton, lm, hybrid = spent
    assert newton < lm
    assert newton < hybrid
