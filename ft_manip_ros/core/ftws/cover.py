"""Compiled sweep: lay certified boxes side by side along the first frozen joint."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ftws.certify import ABSOLUTE_ROUNDING, widest, within_tolerance
from ft_manip_ros.core.ftws.posture import correct
from ft_manip_ros.core.ftws.task_map import TaskArrays
from ft_manip_ros.core.ftws.taylor import Scratch, build, self_motion
from ft_manip_ros.core.ftws.turn_series import CURVE

# Start residuals below this share of the length scale cost the certificate nothing.
_START_RESIDUAL = 1e-6
# The same, times the half-width to prove to the third power: what its bound is about.
_START_SHARE = 0.02
_NEWTON_STEPS = 4
# How far apart pieces are put, in half-widths of the last one.
_OVERLAP = 0.95
# Smallest expected ratio of one piece's width to the one before.
_SLOWEST = 0.6
# First half-width to try at a singular posture (rad or m).
_SINGULAR_WIDTH = 0.02


@kernel
def certify_at(
    chain: ChainArrays,
    task: TaskArrays,
    goal: Array,
    q: Array,
    is_free: NDArray[np.bool_],
    combo: NDArray[np.int64],
    halves: Array,
    radius: float,
    tolerance: float,
    guess: float,
    smallest: float,
    s: Scratch,
) -> float:
    """Correct ``q`` (changed) and return the half-width certified around its frozen angle.

    Parameters
    ----------
    radius : float
        Ball of goals (m) to certify for; with 0, postures that only come within ``tolerance``
        count as well.
    """
    tight = min(_START_RESIDUAL * task.length, 0.1 * tolerance)
    wanted = max(tight, min(_START_SHARE * guess**3, 1e-4) * task.length)
    h = start = 0.0
    for _ in range(2):
        norm = correct(
            chain, task, goal, q, is_free, s.model, s.weights, s.gram, s.inverse, wanted,
            _NEWTON_STEPS,
        )  # fmt: skip
        if not norm < 0.1 * task.length:
            return 0.0
        build(chain, task, combo, radius > 0.0, s)
        start = norm + radius + ABSOLUTE_ROUNDING * (1.0 + task.length)
        h = widest(chain, task, q, is_free, halves, start, guess, smallest, s)
        # Much smaller than expected: the start residual may be what is in the way.
        if norm <= tight or h > 0.5 * guess:
            break
        wanted = tight
    if h == 0.0 and radius == 0.0 and start < tolerance:
        h = within_tolerance(
            chain, task, q, is_free, halves, start, _SINGULAR_WIDTH, smallest, tolerance, s
        )
    return h


@kernel
def _keep(chain: ChainArrays, q: Array, is_free: NDArray[np.bool_], h: float, s: Scratch) -> None:
    self_motion(chain, q, is_free, 2.0 * h, s, s.kept[CURVE + 1])
    for i in range(q.shape[0]):
        s.kept[0, i] = q[i]
        for row in range(CURVE):
            s.kept[1 + row, i] = s.directions[row, i]


@kernel
def record(
    pieces: Array,
    count: NDArray[np.int64],
    combo_index: int,
    q: Array,
    combo: NDArray[np.int64],
    halves: Array,
) -> None:
    """Append one certified box: combo index, half-widths, posture (frozen joints included)."""
    k = combo.shape[0]
    if count[0] < pieces.shape[0]:
        row = pieces[count[0]]
        row[0] = combo_index
        for j in range(k):
            row[1 + j] = halves[j]
        for i in range(q.shape[0]):
            row[1 + k + i] = q[i]
    count[0] += 1


@kernel
def sweep(
    chain: ChainArrays,
    task: TaskArrays,
    goal: Array,
    q: Array,
    is_free: NDArray[np.bool_],
    combo: NDArray[np.int64],
    combo_index: int,
    halves: Array,
    radius: float,
    tolerance: float,
    width: float,
    end: float,
    smallest: float,
    pieces: Array,
    count: NDArray[np.int64],
    s: Scratch,
) -> float:
    """Cover from a certified posture towards ``end``; return the frontier that was reached.

    Parameters
    ----------
    q : shape (n,)
        Posture certified by `certify_at` just before (its ``build`` is still in the scratch).
    halves : shape (k,)
        Half-widths of the other frozen joints in [1:]; [0] is scratch.
    width : float
        Half-width certified around ``q``.
    end : float
        Where to stop, on either side of the posture's own frozen position.
    smallest : float
        Give up below this half-width.
    """
    first = combo[0]
    n = q.shape[0]
    kept, trial = s.kept, s.trial
    sign = 1.0 if end >= q[first] else -1.0
    frontier = q[first] + sign * width
    h = width
    trend = 1.0
    _keep(chain, q, is_free, width, s)
    while sign * (end - frontier) > 0.0:
        # Share what is left evenly among the pieces that it takes.
        rest = sign * (end - frontier)
        reach = _OVERLAP * h * trend
        ahead = min(reach, rest / (2.0 * math.ceil(rest / (2.0 * reach))) * (1.0 + 1e-6))
        before = h
        accepted = False
        for _ in range(6):
            target = frontier + sign * ahead
            delta = target - kept[0, first]
            for i in range(n):
                trial[i] = kept[0, i]
                if is_free[i]:
                    step = 0.0
                    for row in range(CURVE, 0, -1):
                        step = delta * (step + kept[row, i])
                    trial[i] += kept[CURVE + 1, i] + step
            trial[first] = target
            h = certify_at(
                chain, task, goal, trial, is_free, combo, halves, radius, tolerance,
                max(h, ahead), smallest, s,
            )  # fmt: skip
            count[1] += 1
            # The overlap that the pieces' ends need against rounding of the angle itself.
            if h >= ahead * (1.0 + 1e-9) + 1e-12:
                accepted = True
                break
            ahead = min(max(0.9 * h, 0.3 * ahead), 0.7 * ahead)
            if ahead < smallest:
                break
        if not accepted:
            return frontier
        trend = min(max(h / before, _SLOWEST), 1.0)
        _keep(chain, trial, is_free, h, s)
        frontier = kept[0, first] + sign * h
        halves[0] = h
        if pieces.shape[0] > 0:
            record(pieces, count, combo_index, trial, combo, halves)
    return frontier
