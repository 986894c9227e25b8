"""Inner minimisation over postures: Levenberg-Marquardt and Newton on the penalty, bounded LM."""

from __future__ import annotations

import math

from numba import njit

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.design.dh_kernels import (
    GRADIENT,
    HESSIAN,
    STEP,
    TRIAL,
    VECTORS,
    DhRows,
    Goals,
    IntArray,
    Limits,
    Work,
)
from ft_manip_ros.core.design.inner_hybrid import minimise_hybrid
from ft_manip_ros.core.design.penalty import derivatives, penalty, solve_shifted, step_scale

# Methods of `minimise`, by code: the order of INNER_METHODS.
NEWTON, LM, HYBRID, BOUNDED_LM = 0, 1, 2, 3
INNER_METHODS = ('newton', 'lm', 'hybrid', 'bounded_lm')


@njit(cache=True, nogil=True, error_model='numpy')
def minimise(
    method: int,
    rows: DhRows,
    goals: Goals,
    goal: int,
    limits: Limits,
    free: IntArray,
    q: Array,
    zero: float,
    max_iterations: int,
    work: Work,
) -> tuple[float, int]:
    """Minimise the penalty over the free joints, starting from and writing to ``q``.

    Parameters
    ----------
    method
        NEWTON, LM, HYBRID (Fletcher and Xu 1987) or BOUNDED_LM.
    zero
        Penalty (m^2 + rad^2) at or below which the goal counts as reached: stop there.

    Returns
    -------
    penalty : float
        At ``q``. ``work`` holds the frames and errors of ``q``.
    evaluations : int
        Penalty evaluations.
    """
    if method == HYBRID:
        return minimise_hybrid(rows, goals, goal, limits, free, q, zero, max_iterations, work)
    if method == BOUNDED_LM:
        return minimise_bounded(rows, goals, goal, limits, free, q, zero, max_iterations, work)
    return minimise_damped(
        method == NEWTON, rows, goals, goal, limits, free, q, zero, max_iterations, work
    )


@njit(cache=True, nogil=True, error_model='numpy')
def minimise_damped(
    second_order: bool,
    rows: DhRows,
    goals: Goals,
    goal: int,
    limits: Limits,
    free: IntArray,
    q: Array,
    zero: float,
    max_iterations: int,
    work: Work,
) -> tuple[float, int]:
    """Damped Newton (``second_order``) or LM on ``||r||^2`` + equation 8; see `minimise`."""
    size = free.shape[0]
    value = penalty(rows, goals, goal, limits, free, q, work)
    evaluations = 1
    damping = 1e-4
    for k in range(q.shape[0]):
        work[VECTORS, TRIAL, k] = q[k]
    at_best = True
    for _ in range(max_iterations):
        if value <= zero or damping > 1e7:
            break
        if derivatives(goals, goal, free, second_order, work) <= 1e-7 * math.sqrt(value):
            break
        before = value
        while damping <= 1e7:
            if not solve_shifted(size, work[HESSIAN], damping, work[VECTORS, GRADIENT], work):
                damping = max(10.0 * damping, 1e-3)
                continue
            scale = step_scale(size, work)
            promised = 0.0
            for k in range(size):
                j = free[k]
                s = scale * work[VECTORS, STEP, k]
                work[VECTORS, TRIAL, j] = q[j] + s
                promised -= s * work[VECTORS, GRADIENT, k]
            trial = penalty(rows, goals, goal, limits, free, work[VECTORS, TRIAL], work)
            evaluations += 1
            at_best = trial < value
            if at_best:
                # Half the penalty has fallen by `gained`; the model promised about half the slope.
                gained = 0.5 * (value - trial)
                value = trial
                for k in range(size):
                    q[free[k]] = work[VECTORS, TRIAL, free[k]]
                if gained > 0.35 * promised:
                    damping = max(0.1 * damping, 1e-12)
                elif gained < 0.1 * promised:
                    damping *= 4.0
                break
            damping *= 8.0
        if before - value <= 1e-9 * before:
            break
    if not at_best:
        value = penalty(rows, goals, goal, limits, free, q, work)
    return value, evaluations


@njit(cache=True, nogil=True, error_model='numpy')
def minimise_bounded(
    rows: DhRows,
    goals: Goals,
    goal: int,
    limits: Limits,
    free: IntArray,
    q: Array,
    zero: float,
    max_iterations: int,
    work: Work,
) -> tuple[float, int]:
    """Projected LM on ``||r||^2`` alone with every posture inside the limits; see `minimise`."""
    size = free.shape[0]
    _clip(free, limits, q)
    value = penalty(rows, goals, goal, limits, free, q, work)
    evaluations = 1
    damping = 1e-4
    for k in range(q.shape[0]):
        work[VECTORS, TRIAL, k] = q[k]
    at_best = True
    for _ in range(max_iterations):
        if value <= zero or damping > 1e7:
            break
        derivatives(goals, goal, free, False, work)
        norm = 0.0
        for row in range(size):
            j = free[row]
            outward = limits.limited[j] and (
                (q[j] >= limits.upper[j] and work[VECTORS, GRADIENT, row] < 0.0)
                or (q[j] <= limits.lower[j] and work[VECTORS, GRADIENT, row] > 0.0)
            )
            if outward:
                # Held at its limit: take it out of the step.
                work[VECTORS, GRADIENT, row] = 0.0
                for col in range(size):
                    work[HESSIAN, row, col] = 0.0
                    work[HESSIAN, col, row] = 0.0
                work[HESSIAN, row, row] = 1.0
            norm += work[VECTORS, GRADIENT, row] ** 2
        if math.sqrt(norm) <= 1e-7 * math.sqrt(value):
            break
        before = value
        while damping <= 1e7:
            if not solve_shifted(size, work[HESSIAN], damping, work[VECTORS, GRADIENT], work):
                damping = max(10.0 * damping, 1e-6)
                continue
            scale = step_scale(size, work)
            for k in range(size):
                work[VECTORS, TRIAL, free[k]] = q[free[k]] + scale * work[VECTORS, STEP, k]
            _clip(free, limits, work[VECTORS, TRIAL])
            trial = penalty(rows, goals, goal, limits, free, work[VECTORS, TRIAL], work)
            evaluations += 1
            at_best = trial < value
            if at_best:
                value = trial
                for k in range(size):
                    q[free[k]] = work[VECTORS, TRIAL, free[k]]
                damping = max(0.2 * damping, 1e-12)
                break
            damping *= 8.0
        if before - value <= 1e-9 * before:
            break
    if not at_best:
        value = penalty(rows, goals, goal, limits, free, q, work)
    return value, evaluations


@njit(cache=True, nogil=True, error_model='numpy')
def _clip(free: IntArray, limits: Limits, q: Array) -> None:
    for k in range(free.shape[0]):
        j = free[k]
        if limits.limited[j]:
            q[j] = min(max(q[j], limits.lower[j]), limits.upper[j])
