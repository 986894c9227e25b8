"""Exposure of moves to a lock, on a gantry whose numbers can be worked out by hand."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from ft_manip_ros.core.planning.exposure import Exposure
from ft_manip_ros.core.planning.limits import MotionLimits
from ft_manip_ros.core.planning.move_times import straight_times


def gantry(bad_from, bad_to):
    """Two slides; the first must not lock between two of its positions."""
    angles = np.tile(np.linspace(0.0, 1.0, 101), (2, 1))
    survived = np.ones((2, 101), dtype=bool)
    survived[0] = (angles[0] < bad_from) | (angles[0] > bad_to)
    no = np.zeros(2, dtype=bool)
    # Jerk so high that moves are all but at constant speed.
    rates = np.ones(2), np.full(2, 1e3), np.full(2, 1e6)
    return Exposure(angles, survived, MotionLimits(np.zeros(2), np.ones(2), no, no, *rates))


def test_at_rest_the_joints_count_that_must_not_lock():
    leg = gantry(0.395, 0.605)
    assert leg.at_rest(np.array([[0.2, 0.5], [0.5, 0.5], [0.8, 0.5]])).tolist() == [0, 1, 0]
    assert leg.least(np.array([[0.5, 0.0], [0.1, 0.0]]), 1).tolist() == [[0.1, 0.0]]


def test_a_move_counts_for_as_long_as_it_is_in_the_bad_range():
    leg = gantry(0.395, 0.605)
    a, b = np.array([[0.0, 0.0]]), np.array([[1.0, 0.0], [0.3, 0.0], [0.5, 0.0]])
    costs = leg.moves(a, b)[0]
    assert costs[1] == pytest.approx(1e-3 * straight_times(a, b, leg.limits)[0, 1])
    # By the quintic profile a fifth of the way in its middle is passed in a ninth of the time.
    assert costs[0] == pytest.approx(0.11, abs=0.05)
    # At rest in the bad range at last: the slow end of the move counts.
    assert costs[2] > costs[0]


def test_the_joint_that_is_exposed_hurries_while_the_other_waits():
    # The second slide has far to go, and would make the first one dawdle in the bad range.
    leg = gantry(0.395, 0.605)
    a, b = np.array([0.3, 0.0]), np.array([0.7, 1.0])
    way = leg.best_way(a, b, np.empty((0, 2)))
    assert len(way) == 1
    assert way[0].tolist() in ([0.7, 0.0], [0.3, 1.0])
    stops = np.array([a, *way, b])
    around = sum(leg.moves(p[None], q[None])[0, 0] for p, q in pairwise(stops))
    assert around < 0.6 * leg.moves(a[None], b[None])[0, 0]


def test_nothing_is_gone_by_where_the_straight_way_is_as_good():
    leg = gantry(0.395, 0.605)
    others = np.array([[0.9, 0.9]])
    assert leg.best_way(np.array([0.0, 0.0]), np.array([0.3, 0.9]), others) == []
