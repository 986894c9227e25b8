"""P* against dense grids, Brent against scipy, the worst angles against a dense cold grid."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from ft_manip_ros.core.design.p_star import (
    brent_ask,
    brent_start,
    brent_tell,
    insert,
    p_star_minimise,
    propose,
    wiener_scale,
)


def multimodal(rng):
    weights = rng.normal(size=5) / np.arange(1, 6)
    phases = rng.uniform(0, 2 * np.pi, 5)
    return lambda x: float(np.sum(weights * np.sin(np.arange(1, 6) * x + phases)))


def test_it_finds_the_global_minimum_of_nearly_all_multimodal_functions():
    rng = np.random.default_rng(0)
    grid = np.linspace(-3, 3, 1501)
    missed, used = 0, 0
    for _ in range(100):
        f = multimodal(rng)
        x, value, evaluations = p_star_minimise(f, -3, 3)
        assert f(x) == value
        assert -3 <= x <= 3
        missed += value > min(f(x) for x in grid) + 1e-3
        used += evaluations
    # A statistical method: a dense grid of as many points misses far more.
    assert missed <= 5
    assert used / 100 < 40


def test_it_beats_a_grid_of_as_many_points():
    rng = np.random.default_rng(1)
    closer = 0
    for _ in range(50):
        f = multimodal(rng)
        _, value, evaluations = p_star_minimise(f, -3, 3)
        closer += value <= min(f(x) for x in np.linspace(-3, 3, evaluations))
    assert closer >= 45


def test_it_stays_within_its_evaluations():
    calls = []

    def f(x):
        calls.append(x)
        return np.cos(40 * x)

    _, _, evaluations = p_star_minimise(f, 0, 1, evaluations=25)
    assert len(calls) == evaluations <= 25


def test_brent_finds_what_scipy_finds():
    rng = np.random.default_rng(2)
    for _ in range(20):
        centre, quartic = rng.uniform(-0.5, 0.5), rng.uniform(0, 3)

        def f(x, centre=centre, quartic=quartic):
            return (x - centre) ** 2 + quartic * (x - centre) ** 4

        state = np.zeros(10)
        brent_start(-1.0, 0.0, 1.0, f(0.0), state)
        for _ in range(100):
            x = brent_ask(state, 1e-6)
            if np.isnan(x):
                break
            brent_tell(x, f(x), state)
        expected = minimize_scalar(f, bounds=(-1, 1), method='bounded').x
        assert state[2] == pytest.approx(expected, abs=1e-4)


def test_the_next_point_has_the_largest_expected_improvement():
    xs, ys, settled = np.zeros(4), np.zeros(4), np.zeros(4)
    count = 0
    # Equal values: the widest gap promises most, in its middle.
    for x in (0.0, 1.0, 4.0):
        count = insert(x, 1.0, xs, ys, settled, count)
    x, gain = propose(xs, ys, settled, count, 1.0)
    assert x == pytest.approx(2.5)
    # E max(0, -sigma Z) = sigma / sqrt(2 pi), sigma^2 = 3/4
    assert gain == pytest.approx(np.sqrt(0.75) / np.sqrt(2 * np.pi))
    settled[1] = 1.0
    assert propose(xs, ys, settled, count, 1.0)[0] == pytest.approx(0.5)


def test_the_wiener_scale_is_the_mean_squared_slope_of_a_walk():
    rng = np.random.default_rng(3)
    xs = np.linspace(0, 1, 4000)
    ys = np.concatenate([[0], np.cumsum(rng.normal(size=3999) * np.sqrt(2.5 / 3999))])
    assert wiener_scale(xs, ys, 4000) == pytest.approx(2.5, rel=0.1)


def test_points_stay_sorted():
    rng = np.random.default_rng(4)
    xs, ys, settled = np.zeros(50), np.zeros(50), np.zeros(50)
    count = 0
    for x in rng.random(50):
        count = insert(x, 2 * x, xs, ys, settled, count)
    assert np.all(np.diff(xs) >= 0)
    np.testing.assert_array_equal(ys, 2 * xs)
