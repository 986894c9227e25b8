"""The graph search against all paths tried one by one."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from ft_manip_ros.core.planning.lazy_path import (
    ASKS,
    CUT_OFF,
    FOUND,
    GIVEN_UP,
    cheapest_path,
    free_path,
)
from ft_manip_ros.core.planning.move_scan import BLOCKED, FREE, UNKNOWN, no_scan

SCAN, NO_TURNS = no_scan(), np.zeros(2, dtype=bool)


def drawn(seed, share=0.0):
    """Sizes of four layers, times between their postures, seconds extra, and which are blocked."""
    rng = np.random.default_rng(seed)
    sizes = rng.integers(1, 5, 4)
    between, extra = rng.uniform(0.1, 2.0, (4, 4, 4)), rng.uniform(0.0, 1.0, (4, 4))
    return sizes, between, extra, rng.random((4, 4, 4)) < share


def steps(path):
    return [(k, 0 if k == 0 else path[k - 1], to) for k, to in enumerate(path)]


def cost(path, between, extra):
    return sum(between[step] + extra[step[0], step[2]] for step in steps(path))


def free_paths(sizes, blocked):
    every = product(*(range(size) for size in sizes))
    return [path for path in every if not any(blocked[step] for step in steps(path))]


def search(sizes, between, extra, blocked, looks=1000):
    """The lazy search, asking about every move; how it ended, and what it asked about."""
    known, asked = np.full((4, 4, 4), UNKNOWN, dtype=np.int8), []
    between = between.copy()
    while True:
        end, path, layer, looks = free_path(
            between, extra, sizes, known, np.zeros((4, 4, 2)), np.zeros(2), NO_TURNS, SCAN, looks
        )
        if end != ASKS:
            return end, tuple(path.tolist()), layer, asked
        step = steps(path)[layer]
        asked.append(step)
        known[step] = BLOCKED if blocked[step] else FREE
        if blocked[step]:
            between[step] = np.inf
            looks -= 1


@pytest.mark.parametrize('seed', range(6))
def test_least_time_of_all_paths(seed):
    sizes, between, extra, blocked = drawn(seed)
    path, total, cut = cheapest_path(between, extra, sizes)
    least = min(cost(path, between, extra) for path in free_paths(sizes, blocked))
    assert total == pytest.approx(least)
    assert cost(path.tolist(), between, extra) == pytest.approx(total)
    assert cut == 4


@pytest.mark.parametrize('seed', range(20))
def test_least_time_of_all_free_paths(seed):
    sizes, between, extra, blocked = drawn(seed, 0.4)
    end, path, layer, asked = search(sizes, between, extra, blocked)
    assert len(asked) == len(set(asked))
    paths = free_paths(sizes, blocked)
    if paths:
        assert end == FOUND
        least = min(cost(path, between, extra) for path in paths)
        assert cost(path, between, extra) == pytest.approx(least)
        assert path in paths
    else:
        assert end == CUT_OFF
        # Up to the layer before there is a path, and none to this one.
        assert free_paths(sizes[:layer], blocked) if layer else True
        assert not free_paths(sizes[: layer + 1], blocked)


def test_both_ends_of_that_test_come_about():
    ends = {search(*drawn(seed, 0.4))[0] for seed in range(20)}
    assert ends == {FOUND, CUT_OFF}


def test_search_ends_after_so_many_looks_at_a_move_that_is_not_free():
    sizes, between, extra = np.array([4, 4, 4, 4]), np.ones((4, 4, 4)), np.zeros((4, 4))
    blocked = np.zeros((4, 4, 4), dtype=bool)
    blocked[2] = True
    end, _, layer, _ = search(sizes, between, extra, blocked, looks=5)
    assert (end, layer) == (GIVEN_UP, 2)
