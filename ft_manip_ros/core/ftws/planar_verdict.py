"""Verdicts of any order on planar arms without limits: closed form, and witnesses that show it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.ftws.effort import MEMBER, NON_MEMBER, UNDECIDED, Effort
from ft_manip_ros.core.ftws.planar_form import PlanarForm, groups_of, span
from ft_manip_ros.core.ftws.problem import Problem
from ft_manip_ros.core.ftws.verdict import FtwsResult, Verdict


@dataclass(frozen=True)
class PlanarAnswer:
    """Verdict of a goal, or of a ball of goals, in closed form.

    Attributes
    ----------
    code
        MEMBER, UNDECIDED or NON_MEMBER.
    combo, angles
        The worst combination, and positions (rad) of its joints at which it is lost or nearly.
    residual
        Proved distance (m) of a non-member; of an undecided goal, what the worst ROD misses.
    margin
        Radius (m) of the ball around a member that is proved as a whole.
    """

    code: int
    combo: int
    angles: tuple[float, ...]
    residual: float = 0.0
    margin: float = 0.0


def judge_planar(
    form: PlanarForm, goal: Array, off: float, tolerance: float, radius: float, ranges: Array
) -> PlanarAnswer:
    """Judge a goal row (7,) with the ball of radius ``radius`` (m) around it.

    MEMBER where every ROD has a posture within the tolerance. NON_MEMBER where, with the joints
    of the answer frozen at its angles, none comes within it. Between the two, an allowance for
    rounding apart on the boundary itself, goals are UNDECIDED.

    Parameters
    ----------
    off
        Distance of the goal from what the arm can reach at all, off its plane (m).
    tolerance
        m; with orientation, of the residual that mixes both.
    ranges : shape (2, n)
        Where joints can freeze (rad).
    """
    allowed = float(form.allowance(goal[:3], off))
    target = form.target(goal)
    filled = tolerance - allowed
    slacks, worst, inside = form.slacks(np.array([target]), np.array([filled]))
    slack, combo = float(slacks[0]), int(worst[0])
    if off <= tolerance and slack - radius * form.leverage >= -filled:
        margin = max((slack - allowed) / form.leverage, radius, 0.0)
        return PlanarAnswer(MEMBER, combo, (), margin=margin)
    turn = form.turn(goal) if form.oriented else 0.0
    angles = _worst_angles(form, combo, target, bool(inside[0]), turn)
    joints = form.combos[combo]
    # A turn away is the same place; what the operating limits do not allow is not claimed.
    lower, upper = ranges[:, joints]
    angles += 2.0 * np.pi * np.round((0.5 * (lower + upper) - angles) / (2.0 * np.pi))
    angles = np.clip(angles, lower, upper)
    residual = miss_at(form, combo, angles, target, turn) - allowed
    code = NON_MEMBER if residual > tolerance + radius else UNDECIDED
    return PlanarAnswer(code, combo, tuple(angles.tolist()), max(residual, 0.0))


def closed_form(
    problem: Problem, form: PlanarForm, goal: Array, off: float, effort: Effort
) -> FtwsResult:
    """Judge a goal row (7,), whose distance off the plane (m) is known."""
    x, y, z = goal[:3].tolist()
    answer = judge_planar(form, goal, off, effort.tolerance, effort.radius, problem.ranges)
    if answer.code == MEMBER:
        reason = f'closed form: a posture exists at all positions of any {problem.order} joints'
        return FtwsResult(
            (x, y, z), Verdict.MEMBER, reason, margin=answer.margin, closed_form=True
        )
    joints = tuple(problem.chain.joint_names[j] for j in problem.combos[answer.combo])
    residual, margin = answer.residual, 0.0
    if answer.code == NON_MEMBER:
        verdict = Verdict.NON_MEMBER
        reason = f'closed form: no posture comes within {residual:.3g} m with these frozen'
        margin = residual - effort.tolerance
    else:
        verdict = Verdict.UNDECIDED
        reason = 'closed form: reached in part of the ball, or on the boundary to rounding'
    return FtwsResult(
        (x, y, z), verdict, reason, joints, answer.angles, residual, margin, closed_form=True
    )


def judge_many(
    form: PlanarForm, goals: Array, off: Array, tolerance: float, radius: float
) -> NDArray[np.int8]:
    """Verdicts (N,) alone, for positions (N, 7) of arms whose joints freeze all round."""
    allowed = form.allowance(goals[:, :3], off)
    targets = np.array([form.target(goal) for goal in goals])
    filled = tolerance - allowed
    slack = form.slacks(targets, filled)[0]
    member = (off <= tolerance) & (slack - radius * form.leverage >= -filled)
    lost = -slack - allowed > tolerance + radius
    return np.where(member, MEMBER, np.where(lost, NON_MEMBER, UNDECIDED)).astype(np.int8)


def miss_at(
    form: PlanarForm, combo: int, angles: Array, target: complex, turn: float = 0.0
) -> float:
    """Distance (m) by which a ROD misses a goal, with its joints frozen at given angles.

    With orientation it is a lower bound of the residual that mixes position and orientation: a
    tool turned by d, ``u = 2 sin(d / 2)``, comes nearer by at most u times the length g of its
    rigid group, and ``min_u hypot(miss - g u, length u) = miss length / hypot(length, g)``.
    """
    n = len(form.links)
    q = np.zeros(n)
    joints = form.combos[combo]
    q[joints] = angles
    base, groups, tail = groups_of(n, joints.tolist(), form.oriented)
    turns = np.cumsum(form.signs * q)
    turned = form.links * np.exp(1j * turns)
    place = target - turned[base].sum()
    share = 1.0
    if form.oriented:
        # The tool's group is rigid: all of it turns until the tool has the goal's direction.
        place -= turned[tail].sum() * np.exp(1j * (turn - turns[-1]))
        group = abs(turned[tail].sum() + turned[-1])
        share = form.length / float(np.hypot(form.length, group))
    lengths = [abs(turned[group].sum()) for group in groups]
    total = float(sum(lengths))
    hole = 2.0 * max(lengths) - total if lengths else 0.0
    return share * float(max(abs(place) - total, hole - abs(place), 0.0))


def _worst_angles(
    form: PlanarForm, combo: int, target: complex, inside: bool, turn: float
) -> Array:
    """Frozen angles (k,) that give the groups of a ROD the lengths that are worst for a goal."""
    n = len(form.links)
    joints = form.combos[combo].tolist()
    base, groups, tail = groups_of(n, joints, form.oriented)
    lengths = np.abs(form.links).tolist()
    heading = np.zeros(n)
    towards = target / abs(target) if abs(target) > 0.0 else 1.0 + 0.0j
    least, most = form.shift[:, combo]
    nearest = min(max(abs(target), least), most)
    shift = (nearest if inside else -most) * towards
    ends = base + tail
    heading[ends] = _directions([lengths[i] for i in ends], shift)
    for number, group in enumerate(groups):
        low, high = span([lengths[i] for i in group])
        wanted = high if inside and number == form.widest[combo] else low
        heading[group] = _directions([lengths[i] for i in group], complex(wanted))
    moved = heading - np.angle(form.links)
    if form.oriented:
        moved[-1] = turn
    # Turns of the links; a frozen joint turns its link against the one before it.
    before = np.concatenate([[0.0], moved[:-1]])
    angles: Array = (form.signs * (moved - before))[joints]
    return angles


def _directions(lengths: Sequence[float], end: complex) -> list[float]:
    """Directions (rad) of links that lead from 0 to a place within their `span`."""
    directions = []
    for i, length in enumerate(lengths):
        low, high = span(lengths[i + 1 :])
        distance = abs(end)
        direction = float(np.angle(end))
        product = 2.0 * distance * length
        if product > 0.0:
            # What is left to the others after this link, as long as they can make it.
            rest = min(max(abs(distance - length), low), distance + length, high)
            cosine = (distance**2 + length**2 - rest**2) / product
            direction += float(np.arccos(np.clip(cosine, -1.0, 1.0)))
        directions.append(direction)
        end -= length * np.exp(1j * direction)
    return directions
