"""Prove a goal lost: no posture of the healthy joints brings the tool within its tolerance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ft_manip_ros.core.chain import Array, ChainArrays, SerialChain
from ft_manip_ros.core.ftws.problem import Problem, goal_rows, prepare
from ft_manip_ros.core.ftws.query import distance_off_plane
from ft_manip_ros.core.ftws.refute import refute
from ft_manip_ros.core.ftws.taylor import make_scratch
from ft_manip_ros.core.goal import Goal

# Goals are lost only if they are so for frozen positions this many standard deviations off.
SIGMAS = 3.0
_STACK = 1024


@dataclass(frozen=True, eq=False)
class Refutation:
    """What branch and bound found out.

    Attributes
    ----------
    miss
        Proved distance (m) that every posture keeps from the goal; 0 where nothing is proved.
        For goals with an orientation, radians count into it as the engine weighs them.
    posture : ndarray, shape (n,), or None
        A posture that reaches the goal, where one turned up instead.
    """

    miss: float
    posture: Array | None


@lru_cache(maxsize=8)
def _prepared(chain: SerialChain, mode: str, free_axis: bool) -> Problem:
    return prepare(chain, mode, 1, free_axis)


def refute_goal(
    chain: SerialChain,
    arrays: ChainArrays,
    goal: Goal,
    *,
    frozen: Mapping[str, float],
    sigma: Mapping[str, float],
    position_error: float,
    orientation_error: float,
    boxes: int,
) -> Refutation:
    """Try to prove that a goal is out of reach, for every frozen position that is likely.

    Parameters
    ----------
    chain
        The full arm.
    arrays
        The same with the limits to obey.
    frozen, sigma
        Positions of the frozen joints and their standard deviations (rad or m), by name.
    position_error, orientation_error
        Of the closest posture known (m, rad): nothing beyond it can be proved.
    boxes
        Branch-and-bound boxes to spend at most.
    """
    coupled = bool(chain.driven)
    if coupled:
        chain, arrays, frozen, sigma = _uncoupled(chain, arrays, frozen, sigma)
    oriented = goal.orientation is not None
    problem = _prepared(chain, 'pose' if oriented else 'position', goal.free_axis)
    row = goal_rows([goal], problem.mode)[0][0]
    off = distance_off_plane(problem, row)
    if off > goal.position_tolerance:
        return Refutation(off, None)
    n, total = chain.n, problem.chain.n
    # A free tool axis is one more joint at the end.
    spare = total - n
    if spare:
        full = problem.arrays
        arrays = full._replace(
            lower=np.append(arrays.lower, full.lower[n:]),
            upper=np.append(arrays.upper, full.upper[n:]),
            wraps=np.append(arrays.wraps, full.wraps[n:]),
        )
    q, half = np.zeros(total), np.zeros(total)
    is_free = np.ones(total, dtype=np.bool_)
    for name, position in frozen.items():
        i = chain.index(name)
        q[i], half[i], is_free[i] = position, SIGMAS * sigma.get(name, 0.0), False
    tolerance, best = goal.position_tolerance, position_error
    if oriented:
        length = problem.task.length
        tolerance = float(np.hypot(tolerance, length * goal.orientation_tolerance))
        best = float(np.hypot(best, 2.0 * length * np.sin(0.5 * orientation_error)))
    m = problem.task.position_rows.shape[0] + problem.task.orientation_rows.shape[0]
    outcome, distance, _ = refute(
        arrays,
        problem.task,
        row,
        q,
        is_free,
        half,
        tolerance,
        max(best, tolerance * (1.0 + 1e-6)),
        tolerance,
        boxes,
        np.empty((2, _STACK, total)),
        make_scratch(total, m, 1, problem.oriented),
    )
    if outcome == 1:
        return Refutation(float(distance), None)
    # A posture with free axes is none of an arm whose axes move together.
    reached = outcome == -1 and not coupled
    return Refutation(0.0, q[:n].copy() if reached else None)


def _uncoupled(
    chain: SerialChain,
    arrays: ChainArrays,
    frozen: Mapping[str, float],
    sigma: Mapping[str, float],
) -> tuple[SerialChain, ChainArrays, dict[str, float], dict[str, float]]:
    """The same question for the arm whose every axis is a joint: missed by it, missed by all."""
    free = chain.uncoupled
    ends = np.array([arrays.lower[arrays.driver], arrays.upper[arrays.driver]]) * arrays.ratio
    stuck, blur = {}, {}
    for axis in chain.axes:
        leader = chain.joint_names[axis.joint]
        if leader in frozen:
            stuck[axis.name] = axis.ratio * frozen[leader]
            blur[axis.name] = abs(axis.ratio) * sigma.get(leader, 0.0)
    limited = free.arrays._replace(lower=ends.min(axis=0), upper=ends.max(axis=0))
    return free, limited, stuck, blur
