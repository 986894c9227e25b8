"""Lock each joint of an arm at several angles, plan through random goals, replay every plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.planning.limits import motion_limits
from ft_manip_ros.core.planning.margins import tool_errors
from ft_manip_ros.core.planning.plan import Outcome, Plan, PlanStatus
from ft_manip_ros.core.planning.proof import prove
from ft_manip_ros.core.planning.replan import plan_task
from ft_manip_ros.core.planning.settings import PlanSettings
from ft_manip_ros.core.sim import SimSettings, SimulatedArm

# How long after a planned arrival the simulated arm, which lags, is looked at (s).
SETTLING = 0.19


@dataclass
class Tally:
    """Counts over goals, and the worst of what the replays showed."""

    goals: int = 0
    reachable: int = 0
    lost: int = 0
    undecided: int = 0
    replayed: int = 0
    arrived: int = 0
    refused: int = 0
    tool_error: float = 0.0  # m
    speed: float = 0.0  # share of the limit
    acceleration: float = 0.0
    jerk: float = 0.0

    def add(self, other: Tally) -> None:
        """Take in another tally."""
        for key in ('goals', 'reachable', 'lost', 'undecided', 'replayed', 'arrived', 'refused'):
            setattr(self, key, getattr(self, key) + getattr(other, key))
        for key in ('tool_error', 'speed', 'acceleration', 'jerk'):
            setattr(self, key, max(getattr(self, key), getattr(other, key)))


def lock_and_finish(
    chain: SerialChain,
    joint: int,
    angle: float,
    rng: np.random.Generator,
    *,
    goals: int,
    poses: bool,
    healthy_goals: bool,
    replayed: int,
    settings: PlanSettings,
) -> Tally:
    """Lock one joint, plan through random goals, prove what is undecided, replay the plan.

    Parameters
    ----------
    angle
        Where the joint is locked (rad or m).
    goals
        How many.
    poses
        Full poses, else positions.
    healthy_goals
        Draw goals that the healthy arm reaches; else such that the locked arm reaches them.
    replayed
        How many of the goals that the plan visits are replayed in the simulated arm.
    """
    start = rng.uniform(chain.lower, chain.upper)
    start[joint] = angle
    postures = rng.uniform(chain.lower, chain.upper, (goals, chain.n))
    if not healthy_goals:
        postures[:, joint] = angle
    rotations, positions = fk(chain, postures)
    wanted = [
        Goal(position, rotation if poses else None)
        for rotation, position in zip(rotations, positions, strict=True)
    ]
    plan = plan_task(
        chain,
        list(enumerate(wanted)),
        frozen={chain.joint_names[joint]: angle},
        sigma={},
        start=start,
        start_velocity=np.zeros(chain.n),
        settings=settings,
    )
    plan = prove(chain, plan, settings).plan
    tally = Tally(goals=goals, refused=goals * (plan.status == PlanStatus.REFUSED))
    for outcome in plan.outcomes:
        tally.reachable += outcome.outcome == Outcome.REACHABLE
        tally.lost += outcome.outcome == Outcome.LOST
        tally.undecided += outcome.outcome in (Outcome.UNDECIDED, Outcome.RELAXED)
    if plan.trajectory is not None:
        _replay(chain, joint, start, plan, replayed, tally)
        _rates(chain, plan, settings, tally)
    return tally


def _replay(
    chain: SerialChain, joint: int, start: Array, plan: Plan, replayed: int, tally: Tally
) -> None:
    """Let the simulated arm, the joint locked, follow the plan, and look where its tool is."""
    assert plan.trajectory is not None
    arm = SimulatedArm(chain, SimSettings(), start=start)
    arm.lock(chain.joint_names[joint], 0.0)
    arm.follow(plan.trajectory.path(), 0.0)
    for outcome in [o for o in plan.outcomes if o.has_posture][:replayed]:
        tally.replayed += 1
        arm.advance(outcome.arrival + SETTLING)
        distance, turn = tool_errors(chain, arm.position, outcome.goal)
        near = distance <= outcome.goal.position_tolerance
        tally.arrived += near and not turn > outcome.goal.orientation_tolerance
        tally.tool_error = max(tally.tool_error, distance)


def _rates(chain: SerialChain, plan: Plan, settings: PlanSettings, tally: Tally) -> None:
    """Largest speed, acceleration and jerk of the trajectory as shares of the limits."""
    assert plan.trajectory is not None
    limits = motion_limits(chain, operating=False, jerk_time=settings.jerk_time)
    t = plan.trajectory
    tally.speed = float(np.max(np.abs(t.velocities) / limits.velocity))
    tally.acceleration = float(np.max(np.abs(t.accelerations) / limits.acceleration))
    steps = np.diff(t.times)[:, None]
    jerk = np.abs(np.diff(t.accelerations, axis=0)) / steps
    # Over the shortest steps the quotient of rounded numbers says nothing.
    tally.jerk = float(np.max((jerk / limits.jerk)[steps[:, 0] > 1e-3], initial=0.0))


def sweep(
    chain: SerialChain,
    *,
    angles: int,
    goals: int,
    poses: bool,
    healthy_goals: bool,
    seed: int,
    replayed: int = 1000,
    settings: PlanSettings | None = None,
) -> Tally:
    """Run `lock_and_finish` for every joint at angles spread over its range; returns the sum."""
    total = Tally()
    for joint in range(chain.n):
        lower, upper = chain.operating_lower[joint], chain.operating_upper[joint]
        for k in range(angles):
            rng = np.random.default_rng([seed, joint, k])
            angle = float(lower + (upper - lower) * (k + 0.5) / angles)
            total.add(
                lock_and_finish(
                    chain,
                    joint,
                    angle,
                    rng,
                    goals=goals,
                    poses=poses,
                    healthy_goals=healthy_goals,
                    replayed=replayed,
                    settings=settings or PlanSettings(),
                )
            )
    return total
