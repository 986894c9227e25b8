"""Compiled verdict on one goal: cover the frozen angles of every combination of failed joints."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.ftws.cover import certify_at, record, sweep
from ft_manip_ros.core.ftws.posture import descend, uniform
from ft_manip_ros.core.ftws.refute import refute
from ft_manip_ros.core.ftws.task_map import TaskArrays
from ft_manip_ros.core.ftws.taylor import Scratch

MEMBER, UNDECIDED, NON_MEMBER = 1, 0, -1

# Failed refutations of one combination before it is left undecided.
_REFUTATIONS = 3
# A first posture that is certified this far to each side (rad or m) needs no second.
_WIDE = 0.05


class Effort(NamedTuple):
    """How hard to try, and what to report."""

    tolerance: float  # m, of the residual
    radius: float  # m, ball of goals to judge as one
    restarts: int  # random starts of the posture search
    smallest_step: float  # rad or m, give a branch up below this half-width
    smallest_gap: float  # rad or m, give an uncovered interval up below this width
    slab: float  # rad or m, first half-width of the other frozen joints' boxes (order > 1)
    boxes: int  # branch-and-bound boxes per refutation
    pieces: int  # certificate attempts per combination
    intervals: bool  # go on after a refutation, for the tolerated intervals
    seed: int


class Work(NamedTuple):
    """Scratch of one thread."""

    scratch: Scratch
    gaps: Array  # (G, 2 k), boxes of frozen positions still to cover: lower ends, upper ends
    box: Array  # (2, k), the one in hand
    halves: Array  # (k,)
    q: Array  # (n,)
    chosen: Array  # (n,)
    is_free: NDArray[np.bool_]  # (n,)
    frozen_half: Array  # (n,)
    boxes: Array  # (2, S, n)
    state: NDArray[np.uint64]  # (1,)


@njit(cache=True, nogil=True)
def _find(
    chain: ChainArrays,
    task: TaskArrays,
    goal: Array,
    combo: NDArray[np.int64],
    effort: Effort,
    count: NDArray[np.int64],
    w: Work,
) -> tuple[float, float]:
    """Search postures at the frozen positions in ``w.q``: best half-width, best residual.

    ``w.chosen`` is left at the posture with the widest certificate, or the smallest residual.
    """
    n = w.q.shape[0]
    s = w.scratch
    widest = 0.0
    best = math.inf
    certified = 0
    guess = 0.1
    for _ in range(effort.restarts):
        for i in range(n):
            if w.is_free[i]:
                w.q[i] = chain.lower[i] + uniform(w.state) * (chain.upper[i] - chain.lower[i])
        residual = descend(
            chain, task, goal, w.q, w.is_free, s.model, s.weights, s.gram, s.trial,
            0.1 * effort.tolerance,
        )  # fmt: skip
        count[1] += 4
        if residual < best and widest == 0.0:
            best = residual
            for i in range(n):
                w.chosen[i] = w.q[i]
        if residual <= effort.tolerance:
            h = certify_at(
                chain, task, goal, w.q, w.is_free, combo, w.halves, effort.radius,
                effort.tolerance, guess, effort.smallest_step, s,
            )  # fmt: skip
            count[1] += 1
            if h > widest:
                widest = h
                guess = h
                for i in range(n):
                    w.chosen[i] = w.q[i]
            if h > 0.0:
                certified += 1
                if certified >= 2 or h > _WIDE:
                    break
    return widest, best


@njit(cache=True, nogil=True)
def _push(gaps: Array, top: int, lo: Array, hi: Array, lower: float, upper: float) -> int:
    """Push the box [lo, hi] with its first side replaced; returns the new top."""
    k = lo.shape[0]
    for j in range(k):
        gaps[top, j], gaps[top, k + j] = lo[j], hi[j]
    gaps[top, 0], gaps[top, k] = lower, upper
    return top + 1


@njit(cache=True, nogil=True)
def _halve(gaps: Array, top: int, lo: Array, hi: Array, side: int) -> int:
    """Push both halves of the box [lo, hi], cut across one side; returns the new top."""
    k = lo.shape[0]
    middle = 0.5 * (lo[side] + hi[side])
    for part in range(2):
        for j in range(k):
            gaps[top, j], gaps[top, k + j] = lo[j], hi[j]
        gaps[top, side if part == 1 else k + side] = middle
        top += 1
    return top


@njit(cache=True, nogil=True)
def cover(
    chain: ChainArrays,
    task: TaskArrays,
    goal: Array,
    combo: NDArray[np.int64],
    combo_index: int,
    ranges: Array,
    effort: Effort,
    known_lost: bool,
    arm: float,
    covered: Array,
    covered_count: NDArray[np.int64],
    witness: Array,
    worst: Array,
    pieces: Array,
    count: NDArray[np.int64],
    w: Work,
) -> int:
    """Judge one combination of failed joints.

    Parameters
    ----------
    combo : shape (k,)
        The failed joints.
    ranges : shape (2, n)
        Where joints can freeze: the operating limits.
    known_lost : bool
        The goal is a non-member already: only the tolerated intervals are wanted.
    arm : float
        Longest distance of the tool from the first frozen axis (m), 1 for a slide.
    covered : shape (R, 2), covered_count : shape (1,), out
        Proved intervals of the first frozen joint (order 1).
    witness : shape (k,), out
        Frozen positions of the refutation, or of the worst residual.
    worst : shape (1,), in and out
        The worst residual, or when refuted the proved distance (m).
    count : shape (2,)
        Pieces recorded, certificate attempts.

    Returns
    -------
    int
        MEMBER, UNDECIDED or NON_MEMBER, for this combination.
    """
    k = combo.shape[0]
    n = w.q.shape[0]
    s = w.scratch
    gaps, lo, hi = w.gaps, w.box[0], w.box[1]
    for i in range(n):
        w.is_free[i] = True
    for j in range(k):
        w.is_free[combo[j]] = False
        gaps[0, j] = ranges[0, combo[j]]
        gaps[0, k + j] = ranges[1, combo[j]]
    top = 1
    verdict = MEMBER
    limit = count[1] + effort.pieces
    enough = effort.tolerance + effort.radius
    covered_count[0] = 0
    failures = 0
    while top > 0:
        if count[1] > limit or top + 2 >= gaps.shape[0]:
            return min(verdict, UNDECIDED)
        top -= 1
        other, width = 0, 0.0
        for j in range(k):
            lo[j], hi[j] = gaps[top, j], gaps[top, k + j]
            w.halves[j] = 0.5 * (hi[j] - lo[j])
            w.q[combo[j]] = 0.5 * (lo[j] + hi[j])
            if j > 0 and w.halves[j] > width:
                other, width = j, w.halves[j]
        if width > effort.slab:
            top = _halve(gaps, top, lo, hi, other)
            continue
        middle = w.q[combo[0]]
        h, best = _find(chain, task, goal, combo, effort, count, w)
        if h == 0.0 and best > enough:
            outcome, distance = 1, 0.9 * best
            if not known_lost:
                # A few cheap attempts at different positions before an expensive one.
                budget = effort.boxes >> max(2 * (_REFUTATIONS - 1 - failures), 0)
                outcome, distance, spent = refute(
                    chain, task, goal, w.chosen, w.is_free, w.frozen_half, enough, best,
                    effort.tolerance, budget, w.boxes, s,
                )  # fmt: skip
                count[1] += spent // 8
            if outcome == 1:
                if not known_lost:
                    for j in range(k):
                        witness[j] = w.q[combo[j]]
                    worst[0] = distance
                verdict = NON_MEMBER
                if not effort.intervals or k > 1:
                    return verdict
                known_lost = True
                # The residual changes by at most `arm` per radian: these are lost as well.
                reach = max((distance - enough) / arm, 0.1 * effort.smallest_gap)
                for side in range(2):
                    lower = lo[0] if side == 0 else middle + reach
                    upper = middle - reach if side == 0 else hi[0]
                    if upper - lower > effort.smallest_gap:
                        top = _push(gaps, top, lo, hi, lower, upper)
                continue
            if outcome == -1:
                h = certify_at(
                    chain, task, goal, w.chosen, w.is_free, combo, w.halves, effort.radius,
                    effort.tolerance, 0.1, effort.smallest_step, s,
                )  # fmt: skip
            else:
                failures += 1
        if h == 0.0:
            # Reachable, or nearly, but not certified over this box: look at smaller ones.
            if best > worst[0] and verdict == MEMBER:
                worst[0] = best
                for j in range(k):
                    witness[j] = w.q[combo[j]]
            if failures >= _REFUTATIONS:
                return min(verdict, UNDECIDED)
            if width > 0.25 * (hi[0] - lo[0]) and width > effort.smallest_gap:
                top = _halve(gaps, top, lo, hi, other)
            elif hi[0] - lo[0] > effort.smallest_gap:
                top = _halve(gaps, top, lo, hi, 0)
            else:
                verdict = min(verdict, UNDECIDED)
                if not effort.intervals:
                    return verdict
            continue
        left = right = middle
        for side in range(2):
            for i in range(n):
                w.q[i] = w.chosen[i]
            h = certify_at(
                chain, task, goal, w.q, w.is_free, combo, w.halves, effort.radius,
                effort.tolerance, h, effort.smallest_step, s,
            )  # fmt: skip
            if h == 0.0:
                break
            w.halves[0] = h
            if pieces.shape[0] > 0:
                record(pieces, count, combo_index, w.q, combo, w.halves)
            frontier = sweep(
                chain, task, goal, w.q, w.is_free, combo, combo_index, w.halves, effort.radius,
                effort.tolerance, h, hi[0] if side == 0 else lo[0], effort.smallest_step,
                pieces, count, s,
            )  # fmt: skip
            if side == 0:
                right = frontier
            else:
                left = frontier
        if k == 1 and covered_count[0] < covered.shape[0]:
            covered[covered_count[0], 0] = max(left, lo[0])
            covered[covered_count[0], 1] = min(right, hi[0])
            covered_count[0] += 1
        for side in range(2):
            lower = lo[0] if side == 0 else right
            upper = left if side == 0 else hi[0]
            if upper - lower > effort.smallest_gap:
                top = _push(gaps, top, lo, hi, lower, upper)
            elif upper > lower:
                # Too narrow to look into, too wide to forget.
                verdict = min(verdict, UNDECIDED)
    return verdict
