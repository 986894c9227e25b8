"""Compiled first attempt on a goal: refute it at the worst of a few frozen positions."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ftws.effort import MEMBER, NON_MEMBER, Effort, Work, copy, freeze
from ft_manip_ros.core.ftws.posture import descend, randomise
from ft_manip_ros.core.ftws.refute import refute
from ft_manip_ros.core.ftws.task_map import TaskArrays

# Frozen positions tried per joint before anything is covered, ends included: order 1, others.
_PROBES, _PROBES_EACH = 9, 3
# Starts at the other positions once one is lost: the worst is wanted, not a proof.
_WORSE_STARTS = 4
# Beside positions that took this many starts or more, so many others are tried.
_HARD_STARTS, _BESIDE = 3, 4


@kernel
def lose(
    chain: ChainArrays,
    task: TaskArrays,
    goal: Array,
    combos: NDArray[np.int64],
    ranges: Array,
    effort: Effort,
    witness: Array,
    w: Work,
) -> tuple[int, int, float]:
    """Try to refute the goal at the worst of a few frozen positions, before any covering.

    Parameters
    ----------
    witness : shape (k,), out
        Frozen positions of the refutation, or of the worst residual.

    Returns
    -------
    outcome : int
        NON_MEMBER when refuted; MEMBER when nothing was found, which says nothing.
    combination : int
    distance : float
        Proved distance (m), or the worst residual.
    """
    s = w.scratch
    at, residual = find_lost(chain, task, goal, combos, ranges, effort, w)
    if at < 0:
        return MEMBER, at, 0.0
    freeze(combos[at], w.is_free)
    for j in range(combos.shape[1]):
        witness[j] = w.chosen[combos[at, j]]
    enough = effort.tolerance + effort.radius
    if residual > enough:
        outcome, distance, _ = refute(
            chain, task, goal, w.chosen, w.is_free, w.frozen_half, enough, residual,
            effort.tolerance, effort.boxes, w.boxes, s,
        )  # fmt: skip
        if outcome == 1:
            return NON_MEMBER, at, distance
        if outcome == -1:
            return MEMBER, -1, 0.0
        residual = distance
    return MEMBER, at, residual


@kernel
def _search(
    chain: ChainArrays,
    task: TaskArrays,
    goal: Array,
    starts: int,
    good: float,
    effort: Effort,
    w: Work,
) -> tuple[float, int]:
    """Descend from ``w.q``, then from random starts, to a residual of at most ``good``.

    Returns the smallest residual (m), with ``w.q`` at its posture, and the descents that it took.
    """
    q, nearest, s = w.q, w.scratch.kept[0], w.scratch
    best = math.inf
    tries = 0
    while tries <= starts:
        if tries > 0:
            randomise(chain, q, w.is_free, w.state)
        tries += 1
        residual = descend(
            chain, task, goal, q, w.is_free, s.model, s.weights, s.gram, s.trial,
            0.1 * effort.tolerance,
        )  # fmt: skip
        if residual < best:
            best = residual
            copy(q, nearest)
        if best <= good:
            break
    copy(nearest, q)
    return best, tries


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

    For single failures also beside those positions of the grid where postures were hardest to
    find.

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
    q, hard = w.q, w.hard
    count, k = combos.shape
    each = _PROBES if k == 1 else _PROBES_EACH
    enough = effort.tolerance + effort.radius
    worst, at = 0.0, -1
    hard[:] = 0.0
    for c in range(count):
        freeze(combos[c], w.is_free)
        randomise(chain, q, w.is_free, w.state)
        for probe in range(each**k):
            rest = probe
            for j in range(k):
                joint = combos[c, j]
                share = (rest % each) / (each - 1)
                rest //= each
                q[joint] = ranges[0, joint] + share * (ranges[1, joint] - ranges[0, joint])
            starts = effort.restarts if worst == 0.0 else min(_WORSE_STARTS, effort.restarts)
            best, tries = _search(
                chain, task, goal, starts, max(worst, effort.tolerance), effort, w
            )
            if best > max(worst, effort.tolerance):
                worst, at = best, c
                copy(q, w.chosen)
            _remember(hard, float(tries), float(c), q[combos[c, 0]])
        if worst > 2.0 * enough:
            break
    if k > 1:
        return at, worst
    for row in range(hard.shape[0]):
        if at >= 0 or hard[row, 0] < _HARD_STARTS:
            break
        c = int(hard[row, 1])
        joint = combos[c, 0]
        freeze(combos[c], w.is_free)
        low, high = ranges[0, joint], ranges[1, joint]
        for step in range(_BESIDE):
            apart = (step // 2 + 1) / (_BESIDE // 2 + 1) * (high - low) / (each - 1)
            place = hard[row, 2] + (apart if step % 2 == 0 else -apart)
            if not low <= place <= high:
                continue
            q[joint] = place
            starts = effort.restarts if worst == 0.0 else min(_WORSE_STARTS, effort.restarts)
            best, _ = _search(chain, task, goal, starts, max(worst, effort.tolerance), effort, w)
            if best > max(worst, effort.tolerance):
                worst, at = best, c
                copy(q, w.chosen)
    return at, worst


@kernel
def _remember(hard: Array, tries: float, combination: float, position: float) -> None:
    """Keep the hardest positions in ``hard`` (H, 3), hardest first: tries, which, where."""
    row = hard.shape[0]
    while row > 0 and tries > hard[row - 1, 0]:
        row -= 1
        if row + 1 < hard.shape[0]:
            for i in range(3):
                hard[row + 1, i] = hard[row, i]
    if row < hard.shape[0]:
        hard[row, 0], hard[row, 1], hard[row, 2] = tries, combination, position
