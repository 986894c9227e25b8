"""Compile (or load) what a search will run, so that no time budget pays for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ft_manip_ros.core.design.cases import CasePool
from ft_manip_ros.core.design.dh_kernels import make_work
from ft_manip_ros.core.design.frozen_sets import frozen_sets
from ft_manip_ros.core.design.objective import Objective
from ft_manip_ros.core.design.problem import DesignProblem
from ft_manip_ros.core.design.restarts import random_state
from ft_manip_ros.core.ftws import query as ftws


def warm_up(problem: DesignProblem) -> None:
    """Run every kernel of the problem's method once, on a grid of two angles."""
    rng = np.random.default_rng(0)
    small = replace(problem, sets=frozen_sets(problem.limits, problem.spec.order, 2))
    p = problem.space.sample(rng)
    found = Objective(small, rng).evaluate(p, give_up=0.0)
    if problem.settings.method == 'worst_cases':
        pool = CasePool(
            problem.goals, problem.limits, small.sets, 0, random_state(rng),
            make_work(problem.spec.dof),
        )  # fmt: skip
        pool.add(0, 0, found.postures[0, 0])
        pool.evaluate(problem.rows(p))
    if problem.settings.prove:
        modes = {'position' if g.orientation is None else 'pose' for g in problem.task.goals}
        for mode in sorted(modes):
            ftws.warm_up(problem.table(p).chain(), order=problem.spec.order, mode=mode)
