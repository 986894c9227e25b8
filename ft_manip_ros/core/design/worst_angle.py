"""Middle maximisation over one frozen angle: P* guided by isotropy, and a dense cold grid."""

from __future__ import annotations

import numpy as np
from numba import njit

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.design.dh_kernels import DhRows, Goals, Limits, Work
from ft_manip_ros.core.design.frozen_sets import FrozenSets, node_angles
from ft_manip_ros.core.design.p_star import (
    FIRST_POINTS,
    bracket,
    brent_ask,
    brent_start,
    brent_tell,
    insert,
    propose,
    wiener_scale,
)
from ft_manip_ros.core.design.penalty import isotropy
from ft_manip_ros.core.design.restarts import RandomState, solve_with_restarts

MAX_ANGLES = 40
# Width (rad) to which Brent's method refines a worst angle.
ANGLE_TOLERANCE = 1e-3


@njit(cache=True, nogil=True, error_model='numpy')
def p_star_goal(
    method: int, rows: DhRows, goals: Goals, goal: int, limits: Limits, sets: FrozenSets,
    give_up: float, zero: float, restarts: int, state: RandomState, work: Work,
    worst: Array, worst_postures: Array,
) -> int:  # fmt: skip
    """Worst angle of every single frozen joint for one goal by P*; outputs as `march_goal`.

    What is minimised over the frozen angle is minus the penalty where the goal is out of reach,
    and the isotropy (equation 9) where it is in reach: the penalty is flat zero there, and a
    small isotropy is the way to the angles where it is not (figure 6 of the paper).
    """
    evaluations = 0
    total = 0.0
    worst[:] = 0.0
    for subset in range(sets.frozen.shape[0]):
        joint = sets.frozen[subset, 0]
        value, used = _p_star_joint(
            method, rows, goals, goal, limits, sets, subset, joint, give_up - total, zero,
            restarts, state, work, worst_postures[subset],
        )  # fmt: skip
        evaluations += used
        worst[subset] = value
        total += value
        if total > give_up:
            break
    return evaluations


@njit(cache=True, nogil=True, error_model='numpy')
def _p_star_joint(
    method: int, rows: DhRows, goals: Goals, goal: int, limits: Limits, sets: FrozenSets,
    subset: int, joint: int, give_up: float, zero: float, restarts: int, state: RandomState,
    work: Work, worst_posture: Array,
) -> tuple[float, int]:  # fmt: skip
    n = worst_posture.shape[0]
    xs, ys = np.empty(MAX_ANGLES + 1), np.empty(MAX_ANGLES + 1)
    settled = np.zeros(MAX_ANGLES + 1)
    brent = np.zeros(10)
    posture, trial = np.zeros(n), np.zeros(n)
    lower, upper = limits.freeze_lower[joint], limits.freeze_upper[joint]
    count, evaluations = 0, 0
    worst = -1.0
    refining = False
    left, right = 0.0, 0.0
    variance = 0.0
    while count < MAX_ANGLES:
        if count < FIRST_POINTS:
            x = lower + (upper - lower) * count / (FIRST_POINTS - 1.0)
        elif refining:
            x = brent_ask(brent, ANGLE_TOLERANCE)
            if x != x:
                refining = False
                for i in range(count - 1):
                    if xs[i] >= left and xs[i + 1] <= right:
                        settled[i] = 1.0
                continue
        else:
            variance = wiener_scale(xs, ys, count)
            middle = bracket(xs, ys, settled, count, variance)
            if middle > 0:
                left, right = xs[middle - 1], xs[middle + 1]
                brent_start(left, xs[middle], right, ys[middle], brent)
                refining = True
                continue
            x, gain = propose(xs, ys, settled, count, variance)
            if gain <= 1e-4:
                break
        posture[joint] = x
        value, used = solve_with_restarts(
            method, rows, goals, goal, limits, sets.free[subset], posture, zero,
            restarts, state, work, trial,
        )  # fmt: skip
        evaluations += used
        if value <= zero:
            value = 0.0
        if value > worst:
            worst = value
            worst_posture[:] = posture
        if worst > give_up:
            break
        guide = -value if value > 0.0 else isotropy(goals, goal, sets.free[subset], work)
        if refining:
            brent_tell(x, guide, brent)
        count = insert(x, guide, xs, ys, settled, count)
    return max(worst, 0.0), evaluations


@njit(cache=True, nogil=True, error_model='numpy')
def grid_goal(
    method: int, rows: DhRows, goals: Goals, goal: int, limits: Limits, sets: FrozenSets,
    give_up: float, zero: float, restarts: int, state: RandomState, work: Work,
    worst: Array, worst_postures: Array,
) -> int:  # fmt: skip
    """Worst grid angles of every set of frozen joints, every node solved cold.

    Slow and without any of the short cuts of `march_goal`, whose outputs it shares: the measure
    for the other middle methods.
    """
    n = worst_postures.shape[1]
    posture, trial = np.zeros(n), np.zeros(n)
    evaluations = 0
    total = 0.0
    worst[:] = 0.0
    nodes = sets.angles.shape[1] ** sets.frozen.shape[1]
    for subset in range(sets.frozen.shape[0]):
        for node in range(nodes):
            posture[:] = 0.0
            node_angles(sets, subset, node, posture)
            value, used = solve_with_restarts(
                method, rows, goals, goal, limits, sets.free[subset], posture, zero,
                restarts, state, work, trial,
            )  # fmt: skip
            evaluations += used
            if node == 0 or (value > zero and value > worst[subset]):
                worst[subset] = value if value > zero else 0.0
                worst_postures[subset] = posture
        total += worst[subset]
        if total > give_up:
            break
    return evaluations
