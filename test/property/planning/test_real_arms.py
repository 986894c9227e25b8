"""Real arms from their URDFs: every joint locked, every plan replayed in the simulated arm."""

from __future__ import annotations

import pytest

from bench.recovery_sweep import sweep
from ft_manip_ros.core.arm_file import load_arm
from support.chains import REAL_ARMS


@pytest.mark.parametrize('arm', ['panda', 'ur5', 'jaco', 'so101', 'baxter', 'tiago'])
@pytest.mark.parametrize('poses', [False, True])
def test_goals_that_the_locked_arm_can_reach_are_reached(arm, poses):
    urdf, base, tip, _ = REAL_ARMS[arm]
    chain = load_arm(urdf, base=base, tip=tip)
    tally = sweep(chain, angles=1, goals=1, poses=poses, healthy_goals=False, seed=3)
    assert tally.goals == chain.n
    assert tally.reachable == tally.goals
    assert tally.arrived == tally.goals
    assert max(tally.speed, tally.acceleration, tally.jerk) < 1.0


def test_what_the_healthy_arm_reaches_is_reached_or_lost_for_good():
    urdf, base, tip, _ = REAL_ARMS['ur5']
    chain = load_arm(urdf, base=base, tip=tip)
    tally = sweep(chain, angles=2, goals=2, poses=False, healthy_goals=True, seed=3)
    assert tally.reachable + tally.lost + tally.undecided == tally.goals
    assert tally.arrived == tally.reachable
    assert tally.lost > 0
