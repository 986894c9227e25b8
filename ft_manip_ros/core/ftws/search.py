"""Compiled search of a posture to cover from."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ftws.cover import certify_at
from ft_manip_ros.core.ftws.effort import Effort, Work, copy
from ft_manip_ros.core.ftws.posture import descend, randomise
from ft_manip_ros.core.ftws.task_map import TaskArrays

# A first posture that is certified this far to each side (rad or m) needs no second.
_WIDE = 0.05


@kernel
def find_posture(
    chain: ChainArrays,
    task: TaskArrays,
    goal: Array,
    combo: NDArray[np.int64],
    effort: Effort,
    guess: float,
    count: NDArray[np.int64],
    w: Work,
) -> tuple[float, float]:
    """Search postures at the frozen positions in ``w.q``: best half-width, best residual.

    ``w.chosen`` is left at the posture with the widest certificate, or the smallest residual.
    """
    q, chosen, is_free, s = w.q, w.chosen, w.is_free, w.scratch
    widest = 0.0
    best = math.inf
    certified = 0
    for _ in range(effort.restarts):
        randomise(chain, q, is_free, w.state)
        residual = descend(
            chain, task, goal, q, is_free, s.model, s.weights, s.gram, s.trial,
            0.1 * effort.tolerance,
        )  # fmt: skip
        count[1] += 4
        if residual < best and widest == 0.0:
            best = residual
            copy(q, chosen)
        if residual <= effort.tolerance:
            h = certify_at(
                chain, task, goal, q, is_free, combo, w.halves, effort.radius,
                effort.tolerance, guess, effort.smallest_step, s,
            )  # fmt: skip
            count[1] += 1
            if h > widest:
                widest = h
                guess = h
                copy(q, chosen)
            if h > 0.0:
                certified += 1
                if certified >= 2 or h > _WIDE:
                    break
    return widest, best
