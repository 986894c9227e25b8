"""Run every compiled path of the planner once, so that none is compiled after a failure."""

from __future__ import annotations

import gc
from dataclasses import replace

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.planning.limits import motion_limits
from ft_manip_ros.core.planning.line import trace
from ft_manip_ros.core.planning.move_scan import no_scan
from ft_manip_ros.core.planning.plan import GoalOutcome, Outcome, Plan, PlanStatus
from ft_manip_ros.core.planning.proof import prove
from ft_manip_ros.core.planning.replan import plan_task
from ft_manip_ros.core.planning.roadmap import Roadmap
from ft_manip_ros.core.planning.settings import PlanSettings


def warm_up(chain: SerialChain, settings: PlanSettings) -> None:
    """Plan poses and a point on an arm, healthy and with its first joint frozen."""
    middle = 0.5 * (chain.lower + chain.upper)
    goals = []
    for share in (0.1, 0.2):
        rotation, position = fk(chain, middle + share * (chain.upper - chain.lower))
        goals.append(Goal(position, rotation))
    goals.append(replace(goals[0], free_axis=True))
    goals.append(Goal(goals[1].position))
    goals.append(replace(goals[0], straight_line=True))
    first = chain.joint_names[0]
    cases: tuple[dict[str, float], ...] = ({}, {first: float(middle[0])})
    limits = motion_limits(chain, operating=False, jerk_time=settings.jerk_time)
    roadmap = Roadmap(limits, lambda a, b: False, no_scan(), settings.seed)
    ends = [roadmap.add(q) for q in (chain.lower, middle, chain.upper)]
    roadmap.link(ends[0], ends[1])
    roadmap.way(ends[:1], ends[2:], 4)
    prove(chain, _undecided(chain, middle), replace(settings, proof_boxes=2))
    # A plan traces no line where it finds no posture for its end.
    healthy = np.zeros(chain.n, dtype=np.bool_)
    trace(chain, chain.arrays, healthy, middle, goals[-1], settings, None)
    for frozen in cases:
        plan_task(
            chain,
            list(enumerate(goals)),
            frozen=frozen,
            sigma=dict.fromkeys(frozen, 0.0001),
            start=middle,
            start_velocity=np.where(np.arange(chain.n) == 0, 0.0, 0.1 * chain.velocity),
            settings=settings,
        )
    # All that was loaded is looked through for garbage once, which takes 0.1 s: not after a fault.
    gc.collect()


def _undecided(chain: SerialChain, q: Array) -> Plan:
    """Return a plan with one open goal, for `prove` to compile itself on."""
    goal = Goal(fk(chain, q)[1])
    nan = float('nan')
    outcome = GoalOutcome(goal, 0, Outcome.UNDECIDED, '', '', 1.0, nan, 0.0, nan, goal)
    return Plan(PlanStatus.HALTED, '', {}, {}, (outcome,))
