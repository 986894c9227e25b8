"""The graph search against all paths tried one by one."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from ft_manip_ros.core.planning.limits import MotionLimits
from ft_manip_ros.core.planning.sequence import choose_postures, straight_time


@pytest.mark.parametrize('seed', range(6))
def test_least_time_of_all_paths(seed):
    rng = np.random.default_rng(seed)
    m = 3
    turns = np.array([False, True, False])
    bound = MotionLimits(
        np.full(m, -3.0), np.full(m, 3.0), turns, turns, *rng.uniform(0.5, 4.0, (3, m))
    )
    rates = (bound.unlimited, bound.velocity, bound.acceleration, bound.jerk)
    groups = [rng.uniform(-3.0, 3.0, (int(rng.integers(1, 5)), m)) for _ in range(4)]
    extra = [rng.uniform(0.0, 1.0, len(group)) for group in groups]
    first = rng.uniform(0.0, 2.0, len(groups[0]))

    def cost(path):
        total = first[path[0]] + sum(extra[k][i] for k, i in enumerate(path))
        for k in range(3):
            total += straight_time(groups[k][path[k]], groups[k + 1][path[k + 1]], *rates)
        return total

    paths = list(product(*(range(len(group)) for group in groups)))
    picks, total = choose_postures(first, groups, bound, extra=extra)
    assert total == pytest.approx(min(cost(path) for path in paths))
    assert cost(picks) == pytest.approx(total)


def test_one_goal():
    bound = MotionLimits(
        *np.array([[-1.0], [1.0]]), np.zeros(1, bool), np.zeros(1, bool), *np.ones((3, 1))
    )
    picks, total = choose_postures(np.array([2.0, 1.0]), [np.array([[0.0], [1.0]])], bound)
    assert (picks, total) == ([1], 1.0)
