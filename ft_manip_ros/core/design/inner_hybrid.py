"""The hybrid Gauss-Newton/BFGS method of Fletcher and Xu (1987) for the inner minimisation.

Near a reached goal the residual vanishes and the Gauss-Newton matrix J^T J is the Hessian in the
limit; out of reach the residual stays and BFGS learns the part that J^T J leaves out. The switch
is theirs: Gauss-Newton whenever the last step removed a fixed share of the penalty.
"""

from __future__ import annotations

import math

from numba import njit

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.design.dh_kernels import (
    COLUMN,
    COLUMN_BEFORE,
    ERROR,
    GRADIENT,
    HESSIAN,
    MATRIX,
    MEMORY,
    STEP,
    TRIAL,
    VECTORS,
    DhRows,
    Goals,
    IntArray,
    Limits,
    Work,
)
from ft_manip_ros.core.design.penalty import derivatives, penalty, solve_shifted, step_scale

# Share of the penalty one step must remove for Gauss-Newton to be kept (Fletcher and Xu: 0.2).
GAUSS_NEWTON_SHARE = 0.2
# y is used only where it keeps the matrix safely positive (Al-Baali and Fletcher 1985).
CURVATURE_SHARE = 0.01


@njit(cache=True, nogil=True, error_model='numpy')
def minimise_hybrid(
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
    """Minimise ``||r||^2`` + equation 8 over the free joints; see `inner.minimise`."""
    size = free.shape[0]
    value = penalty(rows, goals, goal, limits, free, q, work)
    evaluations = 1
    if value <= zero:
        return value, evaluations
    norm = derivatives(goals, goal, free, False, work)
    _use_gauss_newton(size, work)
    gradient, delta, y = work[MEMORY, 0], work[MEMORY, 1], work[MEMORY, 2]
    for k in range(q.shape[0]):
        work[VECTORS, TRIAL, k] = q[k]
    for _ in range(max_iterations):
        if value <= zero or norm <= 1e-7 * math.sqrt(value):
            break
        # J^T J is singular for a redundant arm: the shift picks its shortest step.
        shift = 1e-10 + 1e-6 * min(value, 1.0)
        while not solve_shifted(size, work[MATRIX], shift, work[VECTORS, GRADIENT], work):
            shift *= 100.0
        slope = 0.0
        for k in range(size):
            gradient[k] = work[VECTORS, GRADIENT, k]
            slope += work[VECTORS, STEP, k] * gradient[k]
        scale = step_scale(size, work)
        for k in range(size):
            for row in range(6):
                work[COLUMN_BEFORE, row, k] = work[COLUMN, row, free[k]]
        accepted = False
        trial = value
        for _search in range(30):
            for k in range(size):
                work[VECTORS, TRIAL, free[k]] = q[free[k]] + scale * work[VECTORS, STEP, k]
            trial = penalty(rows, goals, goal, limits, free, work[VECTORS, TRIAL], work)
            evaluations += 1
            # Half the penalty against its slope: Armijo, then the parabola's minimum.
            fall = 0.5 * (value - trial)
            if fall >= -1e-4 * scale * slope:
                accepted = True
                break
            curve = -fall - scale * slope
            scale *= min(0.5, max(0.1, -0.5 * scale * slope / curve))
        if not accepted:
            value = penalty(rows, goals, goal, limits, free, q, work)
            break
        share = (value - trial) / value
        value = trial
        for k in range(size):
            q[free[k]] = work[VECTORS, TRIAL, free[k]]
            delta[k] = scale * work[VECTORS, STEP, k]
        if value <= zero:
            break
        norm = derivatives(goals, goal, free, False, work)
        if share >= GAUSS_NEWTON_SHARE:
            _use_gauss_newton(size, work)
        else:
            _secant(size, free, gradient, delta, y, work)
            _bfgs(size, delta, y, work)
        if share <= 1e-10:
            break
    return value, evaluations


@njit(cache=True, nogil=True, error_model='numpy')
def _use_gauss_newton(size: int, work: Work) -> None:
    for i in range(size):
        for j in range(size):
            work[MATRIX, i, j] = work[HESSIAN, i, j]


@njit(cache=True, nogil=True, error_model='numpy')
def _secant(
    size: int, free: IntArray, gradient: Array, delta: Array, y: Array, work: Work
) -> None:
    """Write J^T J delta + (J - J_before)^T r to ``y``: least squares keep their structure."""
    curvature = 0.0
    plain = 0.0
    for i in range(size):
        total = 0.0
        for j in range(size):
            total += work[HESSIAN, i, j] * delta[j]
        for row in range(6):
            total += (work[COLUMN, row, free[i]] - work[COLUMN_BEFORE, row, i]) * work[
                VECTORS, ERROR, row
            ]
        y[i] = total
        curvature += total * delta[i]
        plain += (work[VECTORS, GRADIENT, i] - gradient[i]) * delta[i]
    if curvature < CURVATURE_SHARE * plain:
        for i in range(size):
            y[i] = work[VECTORS, GRADIENT, i] - gradient[i]


@njit(cache=True, nogil=True, error_model='numpy')
def _bfgs(size: int, delta: Array, y: Array, work: Work) -> None:
    image = work[MEMORY, 3]
    curvature = 0.0
    before = 0.0
    for i in range(size):
        total = 0.0
        for j in range(size):
            total += work[MATRIX, i, j] * delta[j]
        image[i] = total
        before += total * delta[i]
        curvature += y[i] * delta[i]
    if curvature <= 1e-14 or before <= 1e-14:
        return
    for i in range(size):
        for j in range(size):
            work[MATRIX, i, j] += y[i] * y[j] / curvature - image[i] * image[j] / before
