"""A pool of worst cases: goals with frozen joints that recent candidates could not reach."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.design.dh_kernels import (
    DhRows,
    Goals,
    IntArray,
    Limits,
    Work,
    dh_gradient,
)
from ft_manip_ros.core.design.frozen_sets import FrozenSets
from ft_manip_ros.core.design.penalty import penalty
from ft_manip_ros.core.design.problem import ZERO
from ft_manip_ros.core.design.restarts import RandomState, solve_with_restarts


@njit(cache=True, nogil=True, error_model='numpy')
def pool_values(
    method: int,
    rows: DhRows,
    goals: Goals,
    limits: Limits,
    sets: FrozenSets,
    case_goals: IntArray,
    case_sets: IntArray,
    postures: Array,
    zero: float,
    restarts: int,
    give_up: float,
    state: RandomState,
    work: Work,
    values: Array,
    gradients: Array,
) -> tuple[float, int]:
    """Penalty of every case and the gradient of its square root over the DH parameters.

    Parameters
    ----------
    case_goals, case_sets : shape (C,)
        Goal and set of frozen joints of each case.
    postures : shape (C, n), in and out
        Warm starts; the frozen joints' entries are the frozen angles.
    give_up
        Stop once the sum of penalties exceeds this: the caller will not accept it.
    values : shape (C,), out
    gradients : shape (C, 3n), out
        d sqrt(penalty) / d(d, a, alpha) at the minimising posture (envelope theorem).

    Returns
    -------
    total : float
        Sum of the penalties visited.
    evaluations : int
    """
    trial = np.empty(postures.shape[1])
    total = 0.0
    evaluations = 0
    for c in range(case_goals.shape[0]):
        goal = case_goals[c]
        free = sets.free[case_sets[c]]
        value, used = solve_with_restarts(
            method, rows, goals, goal, limits, free, postures[c], zero, restarts, state, work,
            trial,
        )  # fmt: skip
        evaluations += used
        values[c] = value
        for k in range(gradients.shape[1]):
            gradients[c, k] = 0.0
        if value > zero:
            total += value
            if total > give_up:
                return total, evaluations
            # The scratch memory must describe the posture kept, not the last one tried.
            penalty(rows, goals, goal, limits, free, postures[c], work)
            dh_gradient(goals.modes[goal], work, gradients[c])
            size = np.sqrt(value)
            for k in range(gradients.shape[1]):
                gradients[c, k] /= size
    return total, evaluations


@dataclass(frozen=True, eq=False)
class PoolValue:
    """Penalties of all cases for one table: values (C,), slopes (C, 3n), postures (C, n)."""

    total: float
    values: Array
    slopes: Array
    postures: Array


class CasePool:
    """The cases of one attempt, with the postures last kept as warm starts."""

    def __init__(
        self,
        goals: Goals,
        limits: Limits,
        sets: FrozenSets,
        inner: int,
        state: RandomState,
        work: Work,
    ) -> None:
        self.goals, self.limits, self.sets = goals, limits, sets
        self.inner = inner
        self.evaluations = 0
        self._state, self._work = state, work
        self._case_goals: list[int] = []
        self._case_sets: list[int] = []
        self._postures = np.empty((0, len(limits.lower)))

    def add(self, goal: int, subset: int, posture: Array) -> None:
        """Add a case; the frozen joints' entries of ``posture`` (n,) are the frozen angles."""
        self._case_goals.append(goal)
        self._case_sets.append(subset)
        self._postures = np.vstack([self._postures, posture])

    def keep(self, value: PoolValue) -> None:
        """Start the next evaluation from the postures of ``value``."""
        self._postures = value.postures

    def evaluate(self, rows: DhRows, *, restarts: int = 0, give_up: float = np.inf) -> PoolValue:
        """Penalties of all cases for a table; incomplete once their sum exceeds ``give_up``."""
        count, n = self._postures.shape
        value = PoolValue(0.0, np.zeros(count), np.zeros((count, 3 * n)), self._postures.copy())
        total, used = pool_values(
            self.inner, rows, self.goals, self.limits, self.sets,
            np.array(self._case_goals, dtype=np.int64), np.array(self._case_sets, dtype=np.int64),
            value.postures, ZERO, restarts, give_up, self._state, self._work,
            value.values, value.slopes,
        )  # fmt: skip
        self.evaluations += used
        return replace(value, total=total)
