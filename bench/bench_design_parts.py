"""The parts of the design search: inner minimisations and worst frozen angles compared."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.design.dh_kernels import Goals, make_work
from ft_manip_ros.core.design.inner import INNER_METHODS, minimise
from ft_manip_ros.core.design.objective import Objective
from ft_manip_ros.core.design.penalty import penalty
from ft_manip_ros.core.design.problem import ZERO, DesignProblem, design_problem
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import Verdict
from ft_manip_ros.core.task_file import load_task

TABLES = 40
STARTS = 25
SCIPY_STARTS = 3
WORST_TABLES = 12


def run() -> None:
    """Print both tables."""
    problem = design_problem(load_task('paredis_eq_11'))
    rng = np.random.default_rng(0)
    tables = [problem.space.sample(rng) for _ in range(TABLES)]
    print('Inner minimisation over postures, one joint of five frozen, +-150 deg: per solve.')
    print('"best" is the share of solves that end at the best minimum any method found.')
    for name, scale in (('goals of the task', 1.0), ('goals four times as far', 4.0)):
        goals = Goals(scale * problem.goals.positions, *problem.goals[1:])
        print(f'\n{name}')
        print(f'  {"method":<22} {"evaluations":>11} {"us":>8} {"zero":>6} {"best":>6}')
        inner_rows(problem, goals, tables)
    print(
        '\nWorst frozen angle: share of failing (goal, joint) pairs of random tables overlooked,'
    )
    print('against a cold grid of 361 angles a joint with 30 restarts an angle.')
    print(f'  {"method":<32} {"missed":>8} {"false":>6} {"evaluations":>11} {"ms":>9}')
    middle_rows(problem, rng)


def inner_rows(problem: DesignProblem, goals: Goals, tables: list[Array]) -> None:
    """Solve the same starts by every method."""
    rng = np.random.default_rng(1)
    n, lower, upper = problem.spec.dof, problem.limits.lower, problem.limits.upper
    starts = rng.uniform(lower, upper, (TABLES, STARTS, n))
    starts[:, :, 2] = starts[:, :1, 2]
    free = np.array([0, 1, 3, 4])
    work = make_work(n)
    ends: dict[str, Array] = {}
    cost: dict[str, tuple[float, float]] = {}
    for code, name in enumerate(INNER_METHODS):
        # Compiled before anything is timed; CPU time, so that a busy machine does not show.
        minimise(
            code,
            problem.rows(tables[0]),
            goals,
            0,
            problem.limits,
            free,
            starts[0, 0].copy(),
            ZERO,
            1,
            work,
        )
        values, evaluations, begin = np.zeros((TABLES, STARTS)), 0, time.thread_time()
        for i, p in enumerate(tables):
            rows = problem.rows(p)
            for k in range(STARTS):
                q = starts[i, k].copy()
                values[i, k], used = minimise(
                    code, rows, goals, i % 3, problem.limits, free, q, ZERO, 200, work
                )
                evaluations += used
        spent = time.thread_time() - begin
        ends[name] = values
        cost[name] = (evaluations / values.size, spent / values.size * 1e6)
    scipy_values, evaluations, begin = np.zeros((TABLES, SCIPY_STARTS)), 0, time.thread_time()
    for i, p in enumerate(tables):
        for k in range(SCIPY_STARTS):
            value, used = scipy_solve(problem, goals, p, i % 3, starts[i, k], free)
            scipy_values[i, k] = value
            evaluations += used
    spent = time.thread_time() - begin
    ends['scipy least_squares'] = scipy_values
    cost['scipy least_squares'] = (
        evaluations / scipy_values.size,
        spent / scipy_values.size * 1e6,
    )
    penalised = [name for name in ends if name != 'bounded_lm']
    best = np.min([ends[name].min(axis=1) for name in penalised], axis=0)
    for name, values in ends.items():
        # Bounded LM has an objective of its own: without violations to trade against distance.
        floor = ends[name].min(axis=1) if name == 'bounded_lm' else best
        hit = values <= floor[:, None] * (1 + 1e-3) + 1e-10
        used, micro = cost[name]
        print(
            f'  {name:<22} {used:11.1f} {micro:8.1f} {np.mean(values <= 1e-12):6.1%} '
            f'{np.mean(hit):6.1%}'
        )


def scipy_solve(
    problem: DesignProblem, goals: Goals, p: Array, goal: int, start: Array, free: Array
) -> tuple[float, int]:
    """Trust-region least squares on the same residuals, through the same compiled kinematics."""
    work, rows, q = make_work(problem.spec.dof), problem.rows(p), start.copy()

    def residual(x: Array) -> Array:
        q[free] = x
        penalty(rows, goals, goal, problem.limits, free, q, work)
        return np.concatenate([work[10, 0, :3], work[10, 1, free]])

    found = least_squares(residual, start[free], xtol=1e-12, ftol=1e-12, gtol=1e-12)
    # Finite differences: one evaluation a joint and Jacobian.
    return 2.0 * found.cost, found.nfev + found.njev * len(free)


def middle_rows(problem: DesignProblem, rng: np.random.Generator) -> None:
    """Look for the worst angles of random tables by every method."""
    tables = [problem.space.sample(rng) for _ in range(WORST_TABLES)]
    reference = objective(problem, 'newton', 'grid', angles=361, restarts=30)
    truth = [reference.evaluate(p).worst > 1e-8 for p in tables]
    for inner, middle, options in (
        ('newton', 'march', {}),
        ('newton', 'march', {'angles': 129, 'restarts': 12}),
        ('newton', 'p_star', {}),
        ('hybrid', 'p_star', {}),
        ('newton', 'grid', {'restarts': 12}),
    ):
        value = objective(problem, inner, middle, **options)
        missed = false = failing = 0
        begin = time.thread_time()
        for p, expected in zip(tables, truth, strict=True):
            value.forget()
            found = value.evaluate(p).worst > 0.0
            failing += int(expected.sum())
            missed += int((expected & ~found).sum())
            false += int((found & ~expected).sum())
        spent = time.thread_time() - begin
        name = f'{middle} + {inner} {" ".join(f"{k}={v}" for k, v in options.items())}'
        print(
            f'  {name:<32} {missed / failing:8.1%} {false:6d} '
            f'{value.evaluations / len(tables):11.0f} {spent / len(tables) * 1e3:9.2f}'
        )
    engine_row(problem, tables, truth)


def engine_row(
    problem: DesignProblem, tables: list[Array], truth: list[NDArray[np.bool_]]
) -> None:
    """Ask the FTWS engine, which proves what it says, goal by goal."""
    settings = FtwsSettings(margin=False)
    missed = false = open_ = failing = 0
    begin = time.thread_time()
    for p, expected in zip(tables, truth, strict=True):
        results = query(problem.table(p).chain(), problem.goals.positions, settings=settings)
        for result, row in zip(results, expected, strict=True):
            failing += int(row.any())
            missed += row.any() and result.verdict is Verdict.MEMBER
            false += not row.any() and result.verdict is Verdict.NON_MEMBER
            open_ += result.verdict is Verdict.UNDECIDED
    spent = time.thread_time() - begin
    print(
        f'  {"FTWS engine (proofs, per goal)":<32} {missed / failing:8.1%} {false:6d} '
        f'{"-":>11} {spent / len(tables) * 1e3:9.2f}   ({open_} undecided)'
    )


def objective(problem: DesignProblem, inner: str, middle: str, **options: int) -> Objective:
    """Objective on the problem's task, compiled before anything is timed."""
    built = design_problem(problem.task, problem.spec, DesignSettings(**options))  # type: ignore[arg-type]
    value = Objective(built, np.random.default_rng(0), inner=inner, middle=middle)
    value.evaluate(built.space.sample(np.random.default_rng(9)), give_up=0.0)
    value.evaluations = 0
    return value
