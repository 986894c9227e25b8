"""The compiled engine as a function: goals in, raw verdicts out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.ftws.batch import INTERVALS, judge_goals
from ft_manip_ros.core.ftws.effort import Effort
from ft_manip_ros.core.ftws.problem import Problem

_NO_PIECES = np.zeros((0, 0))


@dataclass(frozen=True, eq=False)
class Judged:
    """Raw answers on N goals.

    Attributes
    ----------
    verdicts, combo_of : ndarray, shape (N,)
        MEMBER, UNDECIDED or NON_MEMBER of `judge`; the combination it hangs on, or -1.
    witness : ndarray, shape (N, k)
        Frozen positions (rad or m).
    residuals : ndarray, shape (N,)
        Proved distance of a non-member, worst residual of an undecided goal (m).
    covered : ndarray, shape (N, C, R, 2)
    covered_count : ndarray, shape (N, C)
        Proved intervals of frozen positions (order 1).
    count : ndarray, shape (2,)
        Boxes of the certificate and certificate attempts, of the last goal.
    """

    verdicts: NDArray[np.int64]
    combo_of: NDArray[np.int64]
    witness: Array
    residuals: Array
    covered: Array
    covered_count: NDArray[np.int64]
    count: NDArray[np.int64]


def run_engine(
    problem: Problem, goals: Array, effort: Effort, pieces: Array = _NO_PIECES
) -> Judged:
    """Judge goal rows (N, 7); ``pieces`` (P, 1 + k + n) receives the certificate if N is 1."""
    total = len(goals)
    count, k = problem.combos.shape
    judged = Judged(
        np.zeros(total, dtype=np.int64),
        np.zeros(total, dtype=np.int64),
        np.zeros((total, k)),
        np.zeros(total),
        # Without intervals nobody reads them, and a map has a million goals.
        np.zeros((total, count, INTERVALS if k == 1 and total == 1 else 0, 2)),
        np.zeros((total, count), dtype=np.int64),
        np.zeros(2, dtype=np.int64),
    )
    judge_goals(
        problem.arrays, problem.task, np.ascontiguousarray(goals), problem.combos,
        problem.ranges, problem.arms, problem.table, effort, judged.verdicts, judged.combo_of,
        judged.witness, judged.residuals, judged.covered, judged.covered_count, pieces,
        judged.count,
    )  # fmt: skip
    return judged
