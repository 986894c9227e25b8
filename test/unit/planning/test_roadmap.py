"""Roadmap: ways out of labyrinths, judged by dense sampling; nothing invented; same every time."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.limits import MotionLimits, motion_limits
from ft_manip_ros.core.planning.link_capsules import capsule_model
from ft_manip_ros.core.planning.move_scan import no_scan
from ft_manip_ros.core.planning.obstacles import Obstacle
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
    return Roadmap(square(), touches, no_scan(), seed)


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

    roadmap = Roadmap(square(), sealed, no_scan(), 0)
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


def test_from_nowhere_there_is_no_way():
    roadmap = labyrinth()
    end = roadmap.add(np.array([0.9, 0.5]))
    assert roadmap.way([], [end], 100) is None
    assert roadmap.way([end], [], 100) is None


def test_joints_that_turn_without_end_go_the_short_way_round():
    turns = square(unlimited=True)
    asked = []

    def touches_nothing(a, b):
        asked.append((a, b))
        return False

    roadmap = Roadmap(turns, touches_nothing, no_scan(), 0)
    start, end = roadmap.add(np.array([3.0, 0.0])), roadmap.add(np.array([-3.0, 0.0]))
    assert roadmap.way([start], [end], 100) == [start, end]
    assert all(abs(b[0] - a[0]) < 0.3 for a, b in asked)


def test_compiled_answers_lead_the_same_way():
    arm = load_arm('paredis_table_3')
    wall = Obstacle('wall', 'box', (0.05, 3.0, 3.0), np.array([0.5, 0.0, 0.0]), np.eye(3))
    checker = CollisionChecker(capsule_model(arm, 0.04, (wall,)))
    rng = np.random.default_rng(6)
    free = [q for q in rng.uniform(arm.lower, arm.upper, (400, arm.n)) if not checker.touches(q)]
    healthy = np.arange(1, arm.n)
    limits = motion_limits(arm, operating=False, jerk_time=0.1).take(healthy)
    found = []
    for here, there in zip(free[:12:2], free[1:12:2], strict=True):

        def asked(a, b, here=here):
            full = np.array([here, here])
            full[:, healthy] = a, b
            return checker.move_touches(*full)

        ways = []
        for scan in (checker.scan(here, healthy), no_scan()):
            roadmap = Roadmap(limits, asked, scan, 0)
            ends = [roadmap.add(q[healthy]) for q in (here, there)]
            way = roadmap.way(ends[:1], ends[1:], 400)
            ways.append((roadmap.checks, way and [roadmap.at(node).tolist() for node in way]))
        assert ways[0] == ways[1]
        found.append(ways[0][1])
    assert any(way is None for way in found)
    assert any(way is not None and len(way) > 2 for way in found)
