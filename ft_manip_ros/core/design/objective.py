"""The objective of equation 7: over goals and frozen sets, the sum of the worst penalties."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.design.dh_kernels import Goals, Limits, make_work
from ft_manip_ros.core.design.inner import INNER_METHODS
from ft_manip_ros.core.design.march import march_goal
from ft_manip_ros.core.design.problem import ZERO, DesignProblem
from ft_manip_ros.core.design.restarts import random_state
from ft_manip_ros.core.design.worst_angle import grid_goal, p_star_goal
from ft_manip_ros.core.errors import InputError

# Restarts of a failing angle: marching solves most angles from a neighbour's posture, the others
# start every angle nearly cold.
_RESTARTS = {'march': 4, 'p_star': 12, 'grid': 12}


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Value of one DH table.

    Attributes
    ----------
    total
        Equation 7 (m^2 + rad^2), or a lower bound above ``give_up`` where ``complete`` is False.
    worst : ndarray, shape (P, S)
        Worst penalty of each point and set of frozen joints.
    postures : ndarray, shape (P, S, n)
        The frozen angles it was found at, with the best posture of the other joints.
    """

    total: float
    worst: Array
    postures: Array
    complete: bool

    @property
    def point_penalties(self) -> Array:
        """Share of each point searched for, shape (P,)."""
        return self.worst.sum(axis=1)


class Objective:
    """Equation 7 for one problem, with the chosen inner and middle methods.

    Postures are carried from one candidate to the next (`march` only), so values may differ in
    which local minimum was found; `forget` makes the next value depend on the table alone.

    Parameters
    ----------
    goals, limits
        By default the problem's own; the default search passes its guarded ones.
    inner, middle
        By default those of the problem's settings.
    """

    def __init__(
        self,
        problem: DesignProblem,
        rng: np.random.Generator,
        *,
        goals: Goals | None = None,
        limits: Limits | None = None,
        inner: str = '',
        middle: str = '',
    ) -> None:
        inner = inner or problem.settings.inner_method
        middle = middle or problem.settings.middle_method
        if middle == 'p_star' and problem.spec.order != 1:
            raise InputError(
                'middle', f"'p_star' searches one frozen angle; order {problem.spec.order} is not"
            )
        self.problem = problem
        self.goals = problem.goals if goals is None else goals
        self.limits = problem.limits if limits is None else limits
        self.inner = INNER_METHODS.index(inner)
        self.middle = middle
        self.evaluations = 0
        self._seed = rng.integers(2**63)
        self._work = make_work(problem.spec.dof)
        self.forget()

    def forget(self) -> None:
        """Drop carried postures and start the restarts' random stream afresh."""
        self._rng = np.random.default_rng(self._seed)
        self._state = random_state(self._rng)
        if self.middle == 'march':
            self._postures = self._first_postures(len(self.goals.positions))

    def set_goals(self, goals: Goals) -> None:
        """Ask for more: ``goals`` starts with those of before."""
        more = len(goals.positions) - len(self.goals.positions)
        self.goals = goals
        if self.middle == 'march':
            self._postures = np.concatenate([self._postures, self._first_postures(more)])

    def _first_postures(self, goals: int) -> Array:
        sets, n = self.problem.sets, self.problem.spec.dof
        middle = 0.5 * (self.limits.lower + self.limits.upper)
        # Not all zero: a stretched or folded arm is a stationary point of the penalty.
        shape = (goals, len(sets.frozen), self.problem.nodes, n)
        postures: Array = middle + self._rng.uniform(-1.0, 1.0, shape)
        return postures

    def evaluate(self, p: Array, give_up: float = np.inf) -> Evaluation:
        """Value of parameters ``p`` (3n,); may stop once it is known to exceed ``give_up``."""
        goals, sets = self.goals, self.problem.sets
        rows = self.problem.rows(p)
        count, subsets = len(goals.positions), len(sets.frozen)
        worst = np.zeros((count, subsets))
        postures = np.zeros((count, subsets, self.problem.spec.dof))
        values = np.empty(self.problem.nodes)
        restarts = self.problem.settings.restarts or _RESTARTS[self.middle]
        total = 0.0
        for goal in range(count):
            left = give_up - total
            if self.middle == 'march':
                self.evaluations += march_goal(
                    self.inner, rows, goals, goal, self.limits, sets, self._postures[goal], left,
                    ZERO, restarts, self._state, self._work, values, worst[goal], postures[goal],
                )  # fmt: skip
            else:
                search = p_star_goal if self.middle == 'p_star' else grid_goal
                self.evaluations += search(
                    self.inner, rows, goals, goal, self.limits, sets, left, ZERO, restarts,
                    self._state, self._work, worst[goal], postures[goal],
                )  # fmt: skip
            total += float(worst[goal].sum())
            if total > give_up:
                return Evaluation(total, worst, postures, False)
        return Evaluation(total, worst, postures, True)
