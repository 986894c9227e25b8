"""Plan the rest of a task from a measured state, with some joints frozen or none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.task_map import reach
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.finding import Finding
from ft_manip_ros.core.planning.handover import Handover, paused
from ft_manip_ros.core.planning.limits import (
    CREEP,
    MotionLimits,
    arrays_within,
    motion_limits,
    within_noise,
)
from ft_manip_ros.core.planning.lines import straighten
from ft_manip_ros.core.planning.plan import Plan, PlanStatus
from ft_manip_ros.core.planning.refutation import SIGMAS
from ft_manip_ros.core.planning.reporting import describe, outcomes_of
from ft_manip_ros.core.planning.route import Route, plan_route, stop_route, touch_while_stopping
from ft_manip_ros.core.planning.safety import check_trajectory
from ft_manip_ros.core.planning.settings import PlanSettings, Policy
from ft_manip_ros.core.planning.trajectory import Trajectory
from ft_manip_ros.core.planning.triage import further_postures, triage


def plan_task(
    chain: SerialChain,
    goals: Sequence[tuple[int, Goal]],
    *,
    frozen: Mapping[str, float],
    sigma: Mapping[str, float],
    start: Array,
    start_velocity: Array,
    settings: PlanSettings,
    halt: str = '',
    hints: Mapping[int, Array] | None = None,
    checker: CollisionChecker | None = None,
    handover: Handover | None = None,
) -> Plan:
    """Decide what becomes of the remaining goals and make the motion that visits them.

    The healthy joints start from the measured state without a jump in position or velocity,
    stay within position, speed, acceleration and jerk limits and rest at each goal; the frozen
    ones are held where they stand. The trajectory has passed `check_trajectory`.

    Parameters
    ----------
    chain
        The full arm.
    goals
        Remaining goals in order, with their places in the original task.
    frozen
        Positions (rad or m) of the frozen joints, by name; empty before a failure, when the
        operating limits are obeyed instead of the physical ones.
    sigma
        Their standard deviations; a missing one counts as 0.
    start, start_velocity : shape (n,)
        Measured state of all joints; what is read a hair beyond a limit counts as on it.
    halt
        Why to stop whatever the policy says; goals are judged all the same.
    hints
        Postures, (n,), to start from besides others, by place of the goal.
    checker
        Of bodies that must not touch along the motion, after the stop from the moving state;
        None: nothing is checked.
    handover
        What to do while the plan is being made; None: nothing, it is made at once.

    Raises
    ------
    InputError
        For unknown joints, wrong lengths, NaN or infinity.
    """
    start = chain.check_vector(start, 'start').copy()
    start_velocity = chain.check_vector(start_velocity, 'start_velocity')
    rod = chain.freeze(frozen)
    mask = np.zeros(chain.n, dtype=np.bool_)
    for name, position in frozen.items():
        mask[chain.index(name)] = True
        start[chain.index(name)] = position
    for name, value in sigma.items():
        chain.index(name)
        if not (np.isfinite(value) and value >= 0.0):
            raise InputError(f'sigma of {name!r}', f'is {value}; must be a finite number >= 0')
    limits = motion_limits(chain, operating=not frozen, jerk_time=settings.jerk_time)
    read, start_velocity = within_noise(start, start_velocity, limits)
    start = np.where(mask, start, read)
    healthy = np.flatnonzero(~mask)
    hard = limits.take(healthy)
    stopping = stop_route(start[healthy], start_velocity[healthy], hard, settings)
    here = start.copy()
    here[healthy] = stopping.motion.positions[-1]
    moving = bool((np.abs(start_velocity) > CREEP * limits.velocity)[healthy].any())
    if handover is not None and checker is not None and moving:
        braked, _ = _checked(chain, stopping, healthy, start, start_velocity, frozen, limits)
        if braked is not None:
            handover.stop(braked)
    allowed = () if checker is None else checker.allow_at(here)
    arrays, blur = arrays_within(chain, limits, clear=True), _blur(chain, sigma)
    findings = triage(arrays, rod, mask, goals, here, settings, hints or {}, blur, checker)
    findings, lines = straighten(chain, arrays, mask, findings, here, settings, checker)
    braking = ''
    if checker is not None and len(healthy):
        braking = touch_while_stopping(
            start[healthy], start_velocity[healthy], healthy, here, hard, checker
        )
    if checker is not None and not halt and checker.touches(here):
        halt = f'{checker.what_touches(here)} where the arm comes to rest'

    def more(finding: Finding) -> Array:
        if checker is None:
            return finding.postures.q
        return further_postures(arrays, mask, finding, here, settings, checker)

    chosen, why_not = ([], halt) if halt else _to_visit(findings, bool(frozen), settings)
    route = stopping
    if chosen:
        route = plan_route(
            chain,
            chosen,
            lines,
            start[healthy],
            start_velocity[healthy],
            healthy,
            here,
            limits,
            settings,
            checker,
            more,
        )
        findings = [
            f.left_open(f'{f.reason}, but no way there was found that touches nothing')
            if f.index in route.cut_off
            else f
            for f in findings
        ]
        if route.cut_off and frozen and settings.policy == Policy.FINISH_ALL_OR_HALT:
            route, why_not = stopping, 'the policy is to finish all or halt, and a way is blocked'
    pause = 0.0 if handover is None else handover.pause(route)
    route = paused(route, pause)
    motion, problems = _checked(chain, route, healthy, start, start_velocity, frozen, limits)
    refused = '; '.join(problems)
    if problems and route is not stopping:
        # What the controller follows now may command the joint that failed: stopping is safer.
        route, pause = stopping, 0.0
        motion, problems = _checked(chain, route, healthy, start, start_velocity, frozen, limits)
    outcomes = outcomes_of(chain, findings, route.visits, frozen, sigma)
    status, reason = describe(outcomes, why_not)
    if allowed:
        pairs = ', '.join(f'{a} and {b}' for a, b in allowed)
        reason += f'; not checked, for they touch where the arm comes to rest: {pairs}'
    if braking:
        reason += f'; unavoidable: {braking}'
    if refused:
        instead = 'nothing is sent' if problems else 'the arm stops instead'
        status, reason = PlanStatus.REFUSED, f'the trajectory is unsafe, {instead}: {refused}'
    return Plan(status, reason, dict(frozen), dict(sigma), outcomes, motion, why_not, pause)


def _checked(
    chain: SerialChain,
    route: Route,
    healthy: NDArray[np.intp],
    start: Array,
    start_velocity: Array,
    frozen: Mapping[str, float],
    limits: MotionLimits,
) -> tuple[Trajectory | None, tuple[str, ...]]:
    """The route as a trajectory of all joints that has passed the gate, or what is wrong."""
    trajectory = _expanded(chain, route, healthy, start)
    speed = np.zeros(chain.n)
    speed[healthy] = start_velocity[healthy]
    problems = check_trajectory(
        chain, trajectory, limits, frozen=frozen, start=start, start_velocity=speed
    )
    return (None if problems else trajectory), problems


def _blur(chain: SerialChain, sigma: Mapping[str, float]) -> float:
    """Bound on how far the tool moves when frozen joints stand `SIGMAS` deviations off (m)."""
    span = reach(chain.uncoupled)
    moved = 0.0
    for axis in chain.axes:
        value = sigma.get(chain.joint_names[axis.joint], 0.0)
        moved += SIGMAS * value * abs(axis.ratio) * (1.0 if axis.prismatic else span)
    return moved


def _to_visit(
    findings: Sequence[Finding], degraded: bool, settings: PlanSettings
) -> tuple[list[Finding], str]:
    """Which goals to go to, and why not to any other."""
    possible = [
        finding
        for finding in findings
        if len(finding.postures.q)
        and (finding.relaxation is None or finding.relaxation in settings.accepted)
    ]
    if degraded and settings.policy == Policy.HALT:
        return [], 'the policy is to halt after a failure'
    if degraded and settings.policy == Policy.FINISH_ALL_OR_HALT and len(possible) < len(findings):
        missing = [f.goal.id or f'goal {f.index}' for f in findings if f not in possible]
        return [], f'the policy is to finish all or halt, and {", ".join(missing)} cannot be done'
    return possible, ''


def _expanded(
    chain: SerialChain, route: Route, healthy: NDArray[np.intp], start: Array
) -> Trajectory:
    """The motion of the healthy joints as a trajectory of all, the frozen ones held."""
    motion = route.motion
    count = len(motion.times)
    positions = np.tile(start, (count, 1))
    velocities, accelerations = np.zeros((2, count, chain.n))
    positions[:, healthy] = motion.positions
    velocities[:, healthy] = motion.velocities
    accelerations[:, healthy] = motion.accelerations
    return Trajectory(chain.joint_names, motion.times, positions, velocities, accelerations)
