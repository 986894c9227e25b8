"""The penalty of a posture, ``||r||^2`` plus equation 8, with its gradient and Hessian."""

from __future__ import annotations

import math

from numba import njit

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.design.dh_kernels import (
    COLUMN,
    ERROR,
    FACTOR,
    GRADIENT,
    HESSIAN,
    MEMORY,
    POSITION,
    STEP,
    VECTORS,
    VIOLATION,
    DhRows,
    Goals,
    IntArray,
    Limits,
    Work,
    Z,
    frames,
    jacobian_columns,
    tool_error,
)

# Longest step of one iteration (rad): farther than this the quadratic model means nothing.
MAX_STEP = 1.0


@njit(cache=True, nogil=True, error_model='numpy')
def penalty(
    rows: DhRows, goals: Goals, goal: int, limits: Limits, free: IntArray, q: Array, work: Work
) -> float:
    """Penalty of posture ``q``: squared tool error plus squared limit violations.

    Parameters
    ----------
    free : shape (f,)
        Joints that may move; the others are frozen and their limits are not charged, since a
        joint freezes inside its operating limits.
    q : shape (n,)
        rad.

    Returns
    -------
    float
        m^2 + rad^2. ``work`` keeps the frames, the error and the violations.
    """
    frames(rows, q, work)
    total = tool_error(goals, goal, work)
    for k in range(free.shape[0]):
        j = free[k]
        over = 0.0
        if limits.limited[j]:
            if q[j] > limits.upper[j]:
                over = q[j] - limits.upper[j]
            elif q[j] < limits.lower[j]:
                over = q[j] - limits.lower[j]
        work[VECTORS, VIOLATION, j] = over
        total += over * over
    return total


@njit(cache=True, nogil=True, error_model='numpy')
def derivatives(goals: Goals, goal: int, free: IntArray, second_order: bool, work: Work) -> float:
    """Gradient and Hessian of half the penalty at the posture last given to `penalty`.

    With ``second_order`` the position part of the Hessian is exact (for revolute joints
    d2p/dq_i dq_k = z_i x (z_k x (p - o_k)), i <= k); otherwise it is the Gauss-Newton matrix.

    Returns
    -------
    float
        Norm of the gradient; both are written to ``work``.
    """
    mode = goals.modes[goal]
    jacobian_columns(mode, work)
    m = 3 if mode == POSITION else 6
    e, c, z = work[VECTORS, ERROR], work[COLUMN], work[Z]
    norm = 0.0
    for row in range(free.shape[0]):
        i = free[row]
        slope = work[VECTORS, VIOLATION, i]
        for k in range(m):
            slope += c[k, i] * e[k]
        work[VECTORS, GRADIENT, row] = slope
        norm += slope * slope
        for col in range(row, free.shape[0]):
            j = free[col]
            value = 0.0
            for k in range(m):
                value += c[k, i] * c[k, j]
            if second_order:
                value += (
                    e[0] * (z[i, 1] * c[2, j] - z[i, 2] * c[1, j])
                    + e[1] * (z[i, 2] * c[0, j] - z[i, 0] * c[2, j])
                    + e[2] * (z[i, 0] * c[1, j] - z[i, 1] * c[0, j])
                )
            work[HESSIAN, row, col] = value
            work[HESSIAN, col, row] = value
        if work[VECTORS, VIOLATION, i] != 0.0:
            work[HESSIAN, row, row] += 1.0
    return math.sqrt(norm)


@njit(cache=True, nogil=True, error_model='numpy')
def solve_shifted(size: int, matrix: Array, shift: float, rhs: Array, work: Work) -> bool:
    """Solve ``(matrix + shift I) step = -rhs`` by Cholesky into the row STEP.

    Returns
    -------
    bool
        False where the shifted matrix is not positive definite.
    """
    low = work[FACTOR]
    for i in range(size):
        for j in range(i + 1):
            total = matrix[i, j]
            if i == j:
                total += shift
            for k in range(j):
                total -= low[i, k] * low[j, k]
            if i == j:
                if total <= 1e-14 * (abs(matrix[i, i]) + shift) or total <= 0.0:
                    return False
                low[i, i] = math.sqrt(total)
            else:
                low[i, j] = total / low[j, j]
    step = work[VECTORS, STEP]
    for i in range(size):
        total = -rhs[i]
        for k in range(i):
            total -= low[i, k] * step[k]
        step[i] = total / low[i, i]
    for i in range(size - 1, -1, -1):
        total = step[i]
        for k in range(i + 1, size):
            total -= low[k, i] * step[k]
        step[i] = total / low[i, i]
    return True


@njit(cache=True, nogil=True, error_model='numpy')
def isotropy(goals: Goals, goal: int, free: IntArray, work: Work) -> float:
    """Equation 9 (with its m-th root) of the free joints' Jacobian at the posture in ``work``.

    Position goals use m = 3, the others m = 6; fewer free joints than m give zero.
    """
    mode = goals.modes[goal]
    jacobian_columns(mode, work)
    m = 3 if mode == POSITION else 6
    trace = 0.0
    low = work[MEMORY]
    if low.shape[1] < m or free.shape[0] < m:
        return 0.0
    det = 1.0
    for i in range(m):
        for j in range(i + 1):
            total = 0.0
            for k in range(free.shape[0]):
                total += work[COLUMN, i, free[k]] * work[COLUMN, j, free[k]]
            if i == j:
                trace += total
            for k in range(j):
                total -= low[i, k] * low[j, k]
            if i == j:
                if total <= 0.0:
                    return 0.0
                det *= total
                low[i, i] = math.sqrt(total)
            else:
                low[i, j] = total / low[j, j]
    if trace <= 0.0:
        return 0.0
    return det ** (1.0 / m) / (trace / m)


@njit(cache=True, nogil=True, error_model='numpy')
def step_scale(size: int, work: Work) -> float:
    """Factor that keeps the row STEP no longer than `MAX_STEP`."""
    length = 0.0
    for k in range(size):
        length += work[VECTORS, STEP, k] ** 2
    length = math.sqrt(length)
    return 1.0 if length <= MAX_STEP else MAX_STEP / length
