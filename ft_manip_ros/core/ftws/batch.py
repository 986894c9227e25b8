"""Compiled loop over goals: the joints' combinations in turn, until one refutes the goal."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.ftws.effort import (
    MEMBER,
    NON_MEMBER,
    UNDECIDED,
    Effort,
    make_work,
    start_stream,
)
from ft_manip_ros.core.ftws.judge import cover
from ft_manip_ros.core.ftws.lost import lose
from ft_manip_ros.core.ftws.reach import farthest_miss
from ft_manip_ros.core.ftws.task_map import TaskArrays

# Intervals kept per joint; more than this are merged into "not proved".
INTERVALS = 64
# Coverings of one combination, with other random postures, before it is left undecided.
_ATTEMPTS = 4


@njit(cache=True, nogil=True)
def judge_goals(
    chain: ChainArrays,
    task: TaskArrays,
    goals: Array,
    combos: NDArray[np.int64],
    ranges: Array,
    arms: Array,
    table: Array,
    effort: Effort,
    verdicts: NDArray[np.int64],
    combo_of: NDArray[np.int64],
    witness: Array,
    residuals: Array,
    covered: Array,
    covered_count: NDArray[np.int64],
    pieces: Array,
    count: NDArray[np.int64],
) -> None:
    """Judge N goals of C combinations of k failed joints.

    Parameters
    ----------
    goals : shape (N, 7)
        Position (m) and quaternion (w, x, y, z).
    combos : shape (C, k)
    ranges : shape (2, n)
        Where joints can freeze (rad or m).
    arms : shape (n,)
        How far the tool can be from each axis (m); 1 for a slide.
    table : shape (T, k + 11)
        The arm's reach table.
    verdicts, combo_of : shape (N,), out
        Verdict and the combination that it hangs on (-1: none).
    witness : shape (N, k), out
    residuals : shape (N,), out
        Proved distance or worst residual (m).
    covered : shape (N, C, R, 2), covered_count : shape (N, C), out
        Proved intervals of frozen positions (order 1; R may be 0).
    pieces : shape (P, 1 + k + n), count : shape (2,), out
        The certificate's boxes and how many there were; for N = 1.
    """
    n = ranges.shape[1]
    k = combos.shape[1]
    m = task.position_rows.shape[0] + task.orientation_rows.shape[0]
    work = make_work(n, m, k, task.orientation_rows.shape[0] > 0)
    angles = np.zeros(k)
    worst = np.zeros(1)
    for g in range(goals.shape[0]):
        verdicts[g] = MEMBER
        combo_of[g] = -1
        residuals[g] = 0.0
        count[0] = 0
        count[1] = 0
        miss, row = farthest_miss(table, goals[g], k)
        if row >= 0 and miss > effort.tolerance + effort.radius:
            verdicts[g] = NON_MEMBER
            combo_of[g] = int(table[row, 0])
            residuals[g] = miss
            for j in range(k):
                witness[g, j] = table[row, 1 + j]
        elif effort.radius == 0.0:
            start_stream(work.state, effort.seed, _ATTEMPTS * combos.shape[0])
            outcome, at, distance = lose(
                chain, task, goals[g], combos, ranges, effort, witness[g], work
            )
            if outcome != MEMBER:
                verdicts[g] = outcome
                combo_of[g] = at
                residuals[g] = distance
        if verdicts[g] == UNDECIDED or (
            verdicts[g] == NON_MEMBER and (not effort.intervals or k > 1)
        ):
            continue
        for c in range(combos.shape[0]):
            lost = verdicts[g] == NON_MEMBER
            outcome = UNDECIDED
            for attempt in range(_ATTEMPTS if effort.radius == 0.0 and not lost else 1):
                # The stream depends on the question alone, not on what was asked before.
                start_stream(work.state, effort.seed, c + attempt * combos.shape[0])
                worst[0] = 0.0
                outcome = cover(
                    chain, task, goals[g], combos[c], c, ranges, effort, lost, arms[combos[c, 0]],
                    covered[g, c], covered_count[g, c : c + 1], angles, worst, pieces, count, work,
                )  # fmt: skip
                if outcome != UNDECIDED:
                    break
            if lost:
                continue
            if outcome < verdicts[g] or (outcome < MEMBER and worst[0] > residuals[g]):
                verdicts[g] = min(outcome, verdicts[g])
                combo_of[g] = c
                residuals[g] = worst[0]
                for j in range(k):
                    witness[g, j] = angles[j]
            if outcome == NON_MEMBER and not effort.intervals:
                break
