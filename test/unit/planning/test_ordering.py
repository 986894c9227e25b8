"""Orders against every order tried, and what other planners are told of the locked arm."""

from __future__ import annotations

from itertools import pairwise, permutations

import numpy as np
import pytest
import yaml

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.planning.limits import joint_limits_yaml, motion_limits
from ft_manip_ros.core.planning.move_times import straight_time
from ft_manip_ros.core.planning.ordering import fastest_order, safest_order
from ft_manip_ros.core.planning.replan import plan_task
from ft_manip_ros.core.planning.settings import Order, PlanSettings

ARM = load_arm('paredis_table_3')
LIMITS = motion_limits(ARM, operating=False, jerk_time=0.1)


@pytest.mark.parametrize('seed', range(5))
def test_fastest_order_is_within_a_tenth_of_the_best_of_all(seed):
    rng = np.random.default_rng(seed)
    groups = [rng.uniform(ARM.lower, ARM.upper, (2, ARM.n)) for _ in range(6)]
    first = rng.uniform(0.0, 3.0, 6)
    rates = (LIMITS.unlimited, LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk)

    def nearest(i, j):
        return min(straight_time(a, b, *rates) for a in groups[i] for b in groups[j])

    def cost(order):
        return first[order[0]] + sum(nearest(i, j) for i, j in pairwise(order))

    order = fastest_order(first, groups, LIMITS)
    assert sorted(order) == list(range(6))
    assert cost(order) <= 1.1 * min(cost(p) for p in permutations(range(6)))


def test_safest_goes_by_margin():
    assert safest_order(np.array([0.1, 0.3, 0.1, 0.2])) == [1, 3, 0, 2]


@pytest.mark.parametrize('order', list(Order))
def test_orders_reach_all_goals_and_fastest_is_not_slower(order):
    rng = np.random.default_rng(4)
    qs = rng.uniform(ARM.lower, ARM.upper, (8, ARM.n))
    qs[:, 1] = 0.5
    goals = [(i, Goal(position)) for i, position in enumerate(fk(ARM, qs)[1])]

    def planned(order):
        return plan_task(
            ARM,
            goals,
            frozen={'joint_2': 0.5},
            sigma={},
            start=np.zeros(ARM.n),
            start_velocity=np.zeros(ARM.n),
            settings=PlanSettings(order=order),
        )

    plan = planned(order)
    assert all(outcome.has_posture for outcome in plan.outcomes)
    assert [outcome.index for outcome in plan.outcomes] == list(range(8))
    given = planned(Order.GIVEN)
    arrivals = [outcome.arrival for outcome in given.outcomes]
    assert arrivals == sorted(arrivals)
    if order == Order.FASTEST:
        assert plan.trajectory.duration <= given.trajectory.duration


def test_limits_of_the_locked_arm_are_what_moveit_reads():
    limits = yaml.safe_load(joint_limits_yaml(ARM, {'joint_2': 0.5}))['joint_limits']
    assert list(limits) == list(ARM.joint_names)
    assert limits['joint_2']['min_position'] == limits['joint_2']['max_position'] == 0.5
    assert limits['joint_2']['max_velocity'] == 0.0
    assert limits['joint_1']['max_position'] == pytest.approx(ARM.upper[0])
