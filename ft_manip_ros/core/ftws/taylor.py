"""Compiled Taylor model of the residual along the directions that a certificate uses."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.ftws.local_model import LocalModel, hessian, make_model
from ft_manip_ros.core.ftws.remainder import third_along
from ft_manip_ros.core.ftws.task_map import TaskArrays
from ft_manip_ros.core.ftws.weighting import cholesky_solve, limit_push

# Step along the self-motion per unit of gradient (rad).
_SELF_MOTION_GAIN = 1.0
# Directions that make up the curve of the first frozen joint: tangent, square, cube.
CURVE = 3


class Scratch(NamedTuple):
    """Arrays that the kernels share within one thread: n joints, m equations, k frozen."""

    model: LocalModel
    weights: Array  # (n,)
    gram: Array  # (m, m)
    inverse: Array  # (n, m), A with zero rows for frozen joints
    tensor: Array  # (m, n, n), second derivatives
    directions: Array  # (k+2+m, n), D_0, D_1, D_2, the other tangents, then the columns of A
    curved: Array  # (m, k+2+m, n), the tensor times each direction
    kept: Array  # (5, n), of the piece accepted last: posture, D_0, D_1, D_2, self-motion to take
    trial: Array  # (n,)
    reach: Array  # (n,), |A_i|
    line: Array  # (n,), largest change along D_0
    box: Array  # (n,), largest change
    pairs: Array  # (k+2, k+2), |H[D_a, D_b]|
    mixed: Array  # (k+2,), |H[D_a, A]|
    constants: Array  # (2,), |H[A, A]| and |J A - I|
    defects: Array  # (k+2,), what is left to cancel along each direction
    powers: Array  # (k+2,), largest coefficient of each direction
    buffer: Array  # (3, m)


@njit(cache=True, nogil=True)
def make_scratch(n: int, m: int, k: int) -> Scratch:
    """Allocate the scratch arrays."""
    rows = CURVE + k - 1
    return Scratch(
        make_model(n, m),
        np.zeros(n),
        np.zeros((m, m)),
        np.zeros((n, m)),
        np.zeros((m, n, n)),
        np.zeros((rows + m, n)),
        np.zeros((m, rows + m, n)),
        np.zeros((5, n)),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros((rows, rows)),
        np.zeros(rows),
        np.zeros(2),
        np.zeros(rows),
        np.zeros(rows),
        np.zeros((3, m)),
    )


@njit(cache=True, nogil=True)
def build(chain: ChainArrays, task: TaskArrays, combo: NDArray[np.int64], s: Scratch) -> None:
    """Directions, second-order norms and defects at the evaluated posture, into the scratch.

    Expects ``s.model`` and ``s.inverse`` of the posture (see `posture.correct`).
    """
    jacobian, inverse, d, tensor, curved = (
        s.model.jacobian, s.inverse, s.directions, s.tensor, s.curved,
    )  # fmt: skip
    second, third, cubic = s.buffer[0], s.buffer[1], s.buffer[2]
    pairs, mixed, defects, reach = s.pairs, s.mixed, s.defects, s.reach
    m, n = jacobian.shape
    k = combo.shape[0]
    rows = CURVE + k - 1
    hessian(chain, task, s.model, tensor)
    for j in range(k):
        row = 0 if j == 0 else CURVE + j - 1
        for i in range(n):
            value = 0.0
            for a in range(m):
                value -= inverse[i, a] * jacobian[a, combo[j]]
            d[row, i] = value
        d[row, combo[j]] = 1.0
    for i in range(n):
        square = 0.0
        for a in range(m):
            value = inverse[i, a]
            d[rows + a, i] = value
            square += value * value
        reach[i] = math.sqrt(square)
    # D_1 cancels H[D_0, D_0] / 2, D_2 what is left of the third order along the curve.
    _bend(tensor, d, curved, 0)
    for a in range(m):
        second[a] = 0.5 * _dot(curved[a, 0], d[0])
    _minus_product(inverse, second, d[1])
    third_along(chain, task, s.model, d[0], third)
    for a in range(m):
        cubic[a] = third[a] / 6.0 + _dot(curved[a, 0], d[1])
    _minus_product(inverse, cubic, d[2])
    for row in range(rows):
        total = 0.0
        for a in range(m):
            value = second[a] if row == 1 else cubic[a] if row == 2 else 0.0
            for i in range(n):
                value += jacobian[a, i] * d[row, i]
            total += value * value
        defects[row] = math.sqrt(total)
    total = 0.0
    for a in range(m):
        for b in range(m):
            value = -1.0 if a == b else 0.0
            for i in range(n):
                value += jacobian[a, i] * inverse[i, b]
            total += value * value
    s.constants[1] = math.sqrt(total)
    for row in range(1, rows + m):
        _bend(tensor, d, curved, row)
    for row in range(rows):
        for col in range(row + 1):
            pairs[row, col] = pairs[col, row] = math.sqrt(_square(curved, d, row, col))
        total = 0.0
        for a in range(m):
            total += _square(curved, d, row, rows + a)
        mixed[row] = math.sqrt(total)
    # Cancelled by D_1 and D_2, but for their defects.
    pairs[0, 0] = pairs[0, 1] = pairs[1, 0] = 0.0
    total = 0.0
    for a in range(m):
        for b in range(a + 1):
            total += (1.0 if a == b else 2.0) * _square(curved, d, rows + a, rows + b)
    s.constants[0] = math.sqrt(total)


@njit(cache=True, nogil=True, inline='always')
def _dot(x: Array, y: Array) -> float:
    total = 0.0
    for i in range(x.shape[0]):
        total += x[i] * y[i]
    return total


@njit(cache=True, nogil=True)
def _minus_product(matrix: Array, x: Array, out: Array) -> None:
    """Write ``-matrix x``."""
    for i in range(matrix.shape[0]):
        value = 0.0
        for a in range(matrix.shape[1]):
            value -= matrix[i, a] * x[a]
        out[i] = value


@njit(cache=True, nogil=True)
def _bend(tensor: Array, directions: Array, curved: Array, row: int) -> None:
    """Multiply the tensor by one direction."""
    m, n = tensor.shape[0], tensor.shape[1]
    for a in range(m):
        for i in range(n):
            value = 0.0
            for c in range(n):
                value += tensor[a, i, c] * directions[row, c]
            curved[a, row, i] = value


@njit(cache=True, nogil=True)
def _square(curved: Array, directions: Array, row: int, col: int) -> float:
    """Return ``|H[D_row, D_col]|^2`` from the tensor times ``D_row``."""
    total = 0.0
    for a in range(curved.shape[0]):
        value = 0.0
        for i in range(curved.shape[2]):
            value += curved[a, row, i] * directions[col, i]
        total += value * value
    return total


@njit(cache=True, nogil=True)
def self_motion(
    chain: ChainArrays, q: Array, is_free: NDArray[np.bool_], cap: float, s: Scratch, out: Array
) -> None:
    """Step within the self-motion, at most ``cap`` long, that lets pieces grow.

    A piece's width is governed by how fast the free joints follow the frozen one, so this
    descends ``1/2 t^T W^-1 t`` for the tangent t, whose derivative along z is
    ``-lambda . H[z, D_0]`` with ``t = W J^T lambda``; the weights' own derivative keeps away from
    the limits. Expects the scratch of `build`.
    """
    jacobian, inverse, curved, tangent = s.model.jacobian, s.inverse, s.curved, s.directions[0]
    wraps, lower, upper, work = chain.wraps, chain.lower, chain.upper, s.buffer[0]
    m, n = jacobian.shape
    # lambda = (J W J^T)^-1 J t
    for a in range(m):
        value = 0.0
        for i in range(n):
            if is_free[i]:
                value += jacobian[a, i] * tangent[i]
        work[a] = value
    cholesky_solve(s.gram, work)
    for i in range(n):
        out[i] = 0.0
        if not is_free[i]:
            continue
        value = 0.0
        for a in range(m):
            value += work[a] * curved[a, 0, i]
        if not wraps[i]:
            value += limit_push(lower[i], upper[i], q[i]) * tangent[i] ** 2
        out[i] = value
    # Project on the null space: z - A J z.
    for a in range(m):
        value = 0.0
        for i in range(n):
            value += jacobian[a, i] * out[i]
        work[a] = value
    total = 0.0
    for i in range(n):
        for a in range(m):
            out[i] -= inverse[i, a] * work[a]
        total += out[i] * out[i]
    scale = min(_SELF_MOTION_GAIN, cap / math.sqrt(total)) if total > 0.0 else 0.0
    for i in range(n):
        out[i] *= scale
