"""Compiled verdict on one goal: cover the frozen angles of every combination of failed joints."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ftws.cover import certify_at, record, sweep
from ft_manip_ros.core.ftws.effort import MEMBER, NON_MEMBER, UNDECIDED, Effort, Work, freeze
from ft_manip_ros.core.ftws.refute import refute
from ft_manip_ros.core.ftws.search import find_posture
from ft_manip_ros.core.ftws.task_map import TaskArrays

# Failed refutations of one combination before it is left undecided.
_REFUTATIONS = 3
# Half-width of the first certificate tried (rad or m).
_GUESS = 0.1
# A sweep ends where pieces get smaller than this share of the interval in hand: another
# posture, of the self-motion's other side, often goes on with large ones.
_SMALL_PIECE = 0.004


@kernel
def _push(gaps: Array, top: int, lo: Array, hi: Array, lower: float, upper: float) -> int:
    """Push the box [lo, hi] with its first side replaced; returns the new top."""
    k = lo.shape[0]
    for j in range(k):
        gaps[top, j], gaps[top, k + j] = lo[j], hi[j]
    gaps[top, 0], gaps[top, k] = lower, upper
    return top + 1


@kernel
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


@kernel
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
    freeze(combo, w.is_free)
    for j in range(k):
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
        floor = max(effort.smallest_step, _SMALL_PIECE * (hi[0] - lo[0]))
        h, best = find_posture(
            chain, task, goal, combo, effort, min(_GUESS, hi[0] - lo[0]), count, w
        )
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
                    effort.tolerance, _GUESS, effort.smallest_step, s,
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
                effort.tolerance, h, hi[0] if side == 0 else lo[0], floor,
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
