"""scipy's global optimisers on the objective of the design search, stopped at zero and proved."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from scipy.optimize import differential_evolution, dual_annealing

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.design.objective import Objective
from ft_manip_ros.core.design.problem import DesignProblem
from ft_manip_ros.core.design.proof import prove

RIVALS = ('differential_evolution', 'dual_annealing')


class _Found(Exception):  # noqa: N818 - not an error: scipy has no other way out
    pass


@dataclass
class Outcome:
    """One run: whether a table was proved, time (s), tables and penalty evaluations."""

    proved: bool
    seconds: float
    tables: int
    evaluations: int


def search(problem: DesignProblem, rival: str, seed: int, budget: float) -> Outcome:
    """Minimise equation 7 with ``rival`` until a table is zero and proved, or time is up."""
    objective = Objective(problem, np.random.default_rng(seed))
    free = np.flatnonzero(problem.space.group >= 0)
    begin = time.perf_counter()
    outcome = Outcome(False, 0.0, 0, 0)

    def value(x: Array) -> float:
        if time.perf_counter() - begin > budget:
            raise _Found
        p = problem.space.lower.copy()
        p[free] = x
        outcome.tables += 1
        total = objective.evaluate(p).total
        if total == 0.0:
            proof = prove(problem.table(p).chain(), problem.task, problem.spec.order)
            outcome.proved = proof.proved
            if proof.proved:
                raise _Found
        return total

    bounds = list(zip(problem.space.lower[free], problem.space.upper[free], strict=True))
    try:
        if rival == 'differential_evolution':
            differential_evolution(value, bounds, seed=seed, maxiter=10**6, polish=False)
        else:
            dual_annealing(value, bounds, seed=seed, maxiter=10**6)
    except _Found:
        pass
    outcome.seconds = time.perf_counter() - begin
    outcome.evaluations = objective.evaluations
    return outcome
