"""Compiled searches before the proofs: a posture to cover from, an angle to refute at."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ftws.cover import certify_at
from ft_manip_ros.core.ftws.effort import Effort, Work, copy, freeze
from ft_manip_ros.core.ftws.posture import descend, randomise
from ft_manip_ros.core.ftws.task_map import TaskArrays

# A first posture that is certified this far to each side (rad or m) needs no second.
_WIDE = 0.05
# Frozen positions tried per joint before anything is covered, ends included: order 1, others.
_PROBES, _PROBES_EACH = 9, 3
# Starts at the other positions once one is lost: the worst is wanted, not a proof.
_WORSE_STARTS = 4


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


@kernel
def find_lost(
    chain: ChainArrays,
    task: TaskArrays,
    goal: Array,
    combos: NDArray[np.int64],
    ranges: Array,
    effort: Effort,
    w: Work,
) -> tuple[int, float]:
    """Look on a grid of frozen positions for one where no posture is found.

    Parameters
    ----------
    combos : shape (C, k)
    ranges : shape (2, n)
        Where joints can freeze.

    Returns
    -------
    combination : int
        -1 where a posture was found everywhere. ``w.chosen`` is left at the nearest posture with
        its joints frozen at the worst of its positions.
    residual : float
        The smallest residual found there (m).
    """
    q, nearest, is_free, s = w.q, w.scratch.kept[0], w.is_free, w.scratch
    count, k = combos.shape
    each = _PROBES if k == 1 else _PROBES_EACH
    enough = effort.tolerance + effort.radius
    worst, at = 0.0, -1
    for c in range(count):
        freeze(combos[c], is_free)
        randomise(chain, q, is_free, w.state)
        for probe in range(each**k):
            rest = probe
            for j in range(k):
                joint = combos[c, j]
                share = (rest % each) / (each - 1)
                rest //= each
                q[joint] = ranges[0, joint] + share * (ranges[1, joint] - ranges[0, joint])
            best = math.inf
            starts = effort.restarts if worst == 0.0 else min(_WORSE_STARTS, effort.restarts)
            for start in range(starts + 1):
                if start > 0:
                    randomise(chain, q, is_free, w.state)
                residual = descend(
                    chain, task, goal, q, is_free, s.model, s.weights, s.gram, s.trial,
                    0.1 * effort.tolerance,
                )  # fmt: skip
                if residual < best:
                    best = residual
                    copy(q, nearest)
                if best <= max(worst, effort.tolerance):
                    break
            copy(nearest, q)
            if best > max(worst, effort.tolerance):
                worst, at = best, c
                copy(nearest, w.chosen)
        if worst > 2.0 * enough:
            break
    return at, worst
