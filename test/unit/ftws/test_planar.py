"""Closed forms for planar arms against the paper and against the engine."""

import numpy as np
import pytest

from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.planar import degrees_of_freedom, planar_ftws, reduce_pose
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import Verdict
from unit.ftws.arms import planar


@pytest.mark.parametrize('order', [1, 2, 3])
def test_the_2k_theorem_for_unit_links(order):
    enough = degrees_of_freedom(order)
    assert planar_ftws([1.0] * enough, order) == [(0.0, 2.0)]
    ((inner, outer),) = planar_ftws([1.0] * (enough - 1), order)
    assert inner == outer == 1.0  # one-dimensional: not fault tolerant
    assert degrees_of_freedom(order, orientation=True) == enough + 1


def test_links_of_any_length_agree_with_the_engine():
    rng = np.random.default_rng(3)
    settings = FtwsSettings(intervals=False)
    kinds = set()
    for _ in range(12):
        lengths = rng.uniform(0.2, 1.5, rng.integers(3, 6))
        intervals = planar_ftws(lengths)
        radii = rng.uniform(0.0, lengths.sum(), 8)
        radii = radii[[all(abs(r - e) > 5e-3 for i in intervals for e in i) for r in radii]]
        points = np.stack([radii, 0.0 * radii, 0.0 * radii], axis=1)
        answers = query(planar(*lengths), points, settings=settings)
        for radius, answer in zip(radii, answers, strict=True):
            inside = any(a <= radius <= b for a, b in intervals)
            assert answer.verdict is (Verdict.MEMBER if inside else Verdict.NON_MEMBER), (
                lengths, radius,
            )  # fmt: skip
            kinds.add(inside)
    assert kinds == {True, False}


def test_a_pose_becomes_a_position_of_the_shorter_arm():
    lengths, position = reduce_pose([1.0, 1.0, 0.5], (1.0, 2.0, np.pi / 2))
    assert lengths == [1.0, 1.0]
    assert position == pytest.approx((1.0, 1.5))


@pytest.mark.parametrize(('lengths', 'order'), [([1.0], 1), ([1.0, -1.0], 1), ([1.0, 1.0], 2)])
def test_impossible_arms_are_refused(lengths, order):
    with pytest.raises(InputError):
        planar_ftws(lengths, order)
