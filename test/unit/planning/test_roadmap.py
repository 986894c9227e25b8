"""Roadmap: ways out of labyrinths, judged by dense sampling; nothing invented; same every time."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from ft_manip_ros.core.planning.limits import MotionLimits
from ft_manip_ros.core.planning.roadmap import Roadmap

# Walls across a unit square, each with one gap, on alternate sides: (x, gap from, gap to).
WALLS = ((0.2, 0.85, 1.0), (0.4, 0.0, 0.15), (0.6, 0.85, 1.0), (0.8, 0.0, 0.15))


def square(unlimited=False):
    ones, yes = np.ones(2), np.full(2, unlimited)
    return MotionLimits(np.zeros(2), ones, yes, yes, ones, ones, ones)


def in_wall(q):
    """Points (..., 2) in a wall of thickness 0.02."""
    hit = np.zeros(np.shape(q)[:-1], dtype=bool)
    for x, low, high in WALLS:
        gap = (q[..., 1] > low) & (q[..., 1] < high)
        hit |= (np.abs(q[..., 0] - x) < 0.01) & ~gap
    return hit


def dense(a, b):
    return a + np.linspace(0.0, 1.0, 500)[:, None] * (b - a)


def touches(a, b):
    return bool(in_wall(dense(a, b)).any())


def labyrinth(seed=0):
    return Roadmap(square(), touches, np.random.default_rng(seed))


def way_through(seed):
    roadmap = labyrinth(seed)
    start, end = roadmap.add(np.array([0.1, 0.5])), roadmap.add(np.array([0.9, 0.5]))
    found = roadmap.way([start], [end], 4000)
    assert found is not None and (found[0], found[-1]) == (start, end)
    return np.array([roadmap.at(node) for node in found])


@pytest.mark.parametrize('seed', range(5))
def test_a_way_out_of_a_labyrinth_touches_nothing(seed):
    way = way_through(seed)
    assert not any(in_wall(dense(a, b)).any() for a, b in pairwise(way))
    # Four gaps on alternate sides need at least four corners; shortened it has few more.
    assert 6 <= len(way) <= 16


def test_the_same_seed_takes_the_same_way():
    np.testing.assert_array_equal(way_through(3), way_through(3))


def test_what_is_walled_in_is_not_reached_and_work_is_bounded():
    def sealed(a, b):
        return bool((np.abs(dense(a, b)[:, 0] - 0.5) < 0.01).any())

    roadmap = Roadmap(square(), sealed, np.random.default_rng(0))
    start, end = roadmap.add(np.array([0.1, 0.5])), roadmap.add(np.array([0.9, 0.5]))
    assert roadmap.way([start], [end], 300) is None
    # A step's last check may come on top.
    assert 300 <= roadmap.checks <= 301


def test_what_was_learnt_is_used_again():
    roadmap = labyrinth()
    start, end = roadmap.add(np.array([0.1, 0.5])), roadmap.add(np.array([0.9, 0.5]))
    assert roadmap.way([start], [end], 4000) is not None
    first = roadmap.checks
    near = roadmap.add(np.array([0.9, 0.6]))
    assert roadmap.way([start], [near], 4000) is not None
    assert roadmap.checks - first < 0.5 * first


def test_any_of_several_ends_will_do():
    roadmap = labyrinth()
    start = roadmap.add(np.array([0.1, 0.5]))
    far, near = roadmap.add(np.array([0.9, 0.5])), roadmap.add(np.array([0.15, 0.2]))
    assert roadmap.way([start], [far, near], 4000) == [start, near]


def test_joints_that_turn_without_end_go_the_short_way_round():
    turns = square(unlimited=True)
    asked = []

    def touches_nothing(a, b):
        asked.append((a, b))
        return False

    roadmap = Roadmap(turns, touches_nothing, np.random.default_rng(0))
    start, end = roadmap.add(np.array([3.0, 0.0])), roadmap.add(np.array([-3.0, 0.0]))
    assert roadmap.way([start], [end], 100) == [start, end]
    assert all(abs(b[0] - a[0]) < 0.3 for a, b in asked)
