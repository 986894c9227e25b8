"""Compiled refutation: branch and bound over the free joints proves that no posture reaches."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ftws.local_model import evaluate
from ft_manip_ros.core.ftws.lower_bound import aim_at, lower_bound
from ft_manip_ros.core.ftws.posture import descend
from ft_manip_ros.core.ftws.spin import beyond_limits, spin_joint
from ft_manip_ros.core.ftws.task_map import TaskArrays
from ft_manip_ros.core.ftws.taylor import Scratch

# Share of the smallest residual found that the boxes have to prove: the ball of lost goals.
_PROVED_SHARE = 0.1
# Half-width that stands for a whole turn of the spin joint, minimised in closed form.
_ANY = -1.0
# Boxes wider than this (half, rad) are not worth a bound: the rest of the series outweighs it.
_HOPELESS = 1.0


@kernel
def _halve(stack: Array, top: int, centre: Array, half: Array, side: int) -> int:
    """Push both halves of a box, cut across one side; returns the new top."""
    half[side] *= 0.5
    for sign in (-1.0, 1.0):
        for i in range(centre.shape[0]):
            stack[0, top, i] = centre[i]
            stack[1, top, i] = half[i]
        stack[0, top, side] += sign * half[side]
        top += 1
    return top


@kernel
def refute(
    chain: ChainArrays,
    task: TaskArrays,
    goal: Array,
    q: Array,
    is_free: NDArray[np.bool_],
    frozen_half: Array,
    enough: float,
    best: float,
    tolerance: float,
    budget: int,
    stack: Array,
    s: Scratch,
) -> tuple[int, float, int]:
    """Prove that no posture of the free joints comes within ``enough`` of the goal.

    Parameters
    ----------
    q : shape (n,)
        Frozen joints at their positions; changed to the posture found, if one is.
    frozen_half : shape (n,)
        Half-widths around the frozen positions to refute at once (0: just these).
    enough : float
        Distance (m) that has to be exceeded: tolerance plus the ball of goals to refute.
    best : float
        Smallest residual known (m), e.g. of the search.
    stack : shape (2, S, n)
        Scratch for the boxes.

    Returns
    -------
    outcome : int
        1 refuted, -1 a posture within ``tolerance`` was found, 0 undecided.
    distance : float
        Proved lower bound of every posture's residual when refuted (m), else the best residual.
    boxes : int
        Boxes spent.
    """
    n = q.shape[0]
    model, weights, gram, trial = s.model, s.weights, s.gram, s.trial
    wraps, lower, upper, prismatic = chain.wraps, chain.lower, chain.upper, chain.prismatic
    if best <= enough:
        return (-1 if best <= tolerance else 0), best, 0
    spin = spin_joint(chain, task, is_free)
    for i in range(spin):
        if frozen_half[i] > 0.0:
            spin = -1  # its axis would move
            break
    spare, aim, aim_round = s.aims[:2], s.aims[2], s.aims[3]
    share, post, centre, half = s.split[0], s.split[1], s.split[2], s.split[3]
    evaluate(chain, task, goal, q, model)
    aim_at(task, goal, -1, model, spare, aim)
    aim_at(task, goal, spin, model, spare, aim_round)
    for i in range(n):
        if not is_free[i]:
            stack[0, 0, i] = q[i]
            stack[1, 0, i] = frozen_half[i]
        elif i == spin:
            stack[0, 0, i] = 0.0
            stack[1, 0, i] = _ANY
        else:
            stack[0, 0, i] = 0.5 * (lower[i] + upper[i])
            stack[1, 0, i] = 0.5 * (upper[i] - lower[i])
    top = 1
    boxes = 0
    proved = math.inf
    while top > 0:
        if boxes >= budget or top + 1 >= stack.shape[1]:
            return 0, best, boxes
        top -= 1
        boxes += 1
        widest = 0
        for i in range(n):
            centre[i] = stack[0, top, i]
            half[i] = stack[1, top, i]
            if half[i] > half[widest] and not prismatic[i]:
                widest = i
        if half[widest] > _HOPELESS and not prismatic[widest]:
            top = _halve(stack, top, centre, half, widest)
            continue
        round_axis = spin if spin >= 0 and half[spin] == _ANY else -1
        if round_axis >= 0:
            half[spin] = 0.0
        target = enough + _PROVED_SHARE * (best - enough)
        bound, norm = lower_bound(
            chain, task, goal, round_axis, centre, half,
            aim_round if round_axis >= 0 else aim, model, spare, share, target,
        )  # fmt: skip
        if bound > target:
            proved = min(proved, bound)
            continue
        if round_axis >= 0 and beyond_limits(chain, goal, spin, centre, half, model):
            for side in range(2):
                for i in range(n):
                    stack[0, top, i] = centre[i]
                    stack[1, top, i] = half[i]
                stack[0, top, spin] = lower[spin] if side == 0 else upper[spin]
                top += 1
            continue
        # A circle that leaves the limits promises more than there is: follow it up rarely.
        if norm < 0.7 * best and (round_axis < 0 or wraps[spin] or boxes % 16 == 0):
            for i in range(n):
                post[i] = centre[i]
            if round_axis >= 0 and not wraps[spin]:
                post[spin] = 0.5 * (lower[spin] + upper[spin])
            found = descend(
                chain, task, goal, post, is_free, model, weights, gram, trial,
                0.1 * tolerance,
            )  # fmt: skip
            if found < best:
                best = found
                evaluate(chain, task, goal, post, model)
                aim_at(task, goal, -1, model, spare, aim)
                aim_at(task, goal, spin, model, spare, aim_round)
            if best <= tolerance:
                for i in range(n):
                    q[i] = post[i]
                return -1, best, boxes
            if best <= enough:
                return 0, best, boxes
        worst = 0
        for i in range(1, n):
            if share[i] * (half[i] > 0.0) > share[worst] * (half[worst] > 0.0):
                worst = i
        if half[worst] < 1e-9:
            return 0, best, boxes
        if round_axis >= 0:
            half[spin] = _ANY
        top = _halve(stack, top, centre, half, worst)
    return 1, proved, boxes
