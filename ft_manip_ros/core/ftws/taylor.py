"""Compiled Taylor model of the residual along the directions that a certificate uses."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.ftws.local_model import LocalModel, hessian, make_model
from ft_manip_ros.core.ftws.posture import cholesky_solve, limit_push
from ft_manip_ros.core.ftws.task_map import TaskArrays

# Step along the self-motion per unit of gradient (rad).
_SELF_MOTION_GAIN = 1.0


class Scratch(NamedTuple):
    """Arrays that the kernels share within one thread: n joints, m equations, k frozen."""

    model: LocalModel
    weights: Array  # (n,)
    gram: Array  # (m, m)
    inverse: Array  # (n, m), A with zero rows for frozen joints
    tensor: Array  # (m, n, n), second derivatives
    directions: Array  # (k+1+m, n), D_0, D_1, the other tangents, then the columns of A
    curved: Array  # (m, k+1+m, n), the tensor times each direction
    kept: Array  # (4, n), of the piece accepted last: posture, D_0, D_1, self-motion to take
    trial: Array  # (n,)
    reach: Array  # (n,), |A_i|
    box: Array  # (n,)
    pairs: Array  # (k+1, k+1), |H[D_a, D_b]|
    mixed: Array  # (k+1,), |H[D_a, A]|
    constants: Array  # (2,), |H[A, A]| and |J A - I|
    defects: Array  # (k+1,), first-order defects of the directions
    buffer: Array  # (m,)


@njit(cache=True, nogil=True)
def make_scratch(n: int, m: int, k: int) -> Scratch:
    """Allocate the scratch arrays."""
    return Scratch(
        make_model(n, m),
        np.zeros(n),
        np.zeros((m, m)),
        np.zeros((n, m)),
        np.zeros((m, n, n)),
        np.zeros((k + 1 + m, n)),
        np.zeros((m, k + 1 + m, n)),
        np.zeros((4, n)),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros((k + 1, k + 1)),
        np.zeros(k + 1),
        np.zeros(2),
        np.zeros(k + 1),
        np.zeros(m),
    )


@njit(cache=True, nogil=True)
def norm_of(x: Array) -> float:
    """Euclidean norm of a vector."""
    total = 0.0
    for i in range(x.shape[0]):
        total += x[i] * x[i]
    return math.sqrt(total)


@njit(cache=True, nogil=True)
def build(chain: ChainArrays, task: TaskArrays, combo: NDArray[np.int64], s: Scratch) -> None:
    """Directions, second-order norms and defects at the evaluated posture, into the scratch.

    Expects ``s.model`` and ``s.inverse`` of the posture (see `posture.correct`).
    """
    jacobian, inverse, d = s.model.jacobian, s.inverse, s.directions
    m, n = jacobian.shape
    k = combo.shape[0]
    hessian(chain, task, s.model, s.tensor)
    for j in range(k):
        row = 0 if j == 0 else j + 1
        for i in range(n):
            value = 0.0
            for a in range(m):
                value -= inverse[i, a] * jacobian[a, combo[j]]
            d[row, i] = value
        d[row, combo[j]] = 1.0
    for a in range(m):
        for i in range(n):
            d[k + 1 + a, i] = inverse[i, a]
    _bend(s, 0)
    for a in range(m):
        value = 0.0
        for i in range(n):
            value += s.curved[a, 0, i] * d[0, i]
        s.buffer[a] = value
    for i in range(n):
        value = 0.0
        for a in range(m):
            value -= 0.5 * inverse[i, a] * s.buffer[a]
        d[1, i] = value
    # What rounding leaves of the residual along the directions, to first order.
    for row in range(k + 1):
        total = 0.0
        for a in range(m):
            value = 0.5 * s.buffer[a] if row == 1 else 0.0
            for i in range(n):
                value += jacobian[a, i] * d[row, i]
            total += value * value
        s.defects[row] = math.sqrt(total)
    total = 0.0
    for a in range(m):
        for b in range(m):
            value = -1.0 if a == b else 0.0
            for i in range(n):
                value += jacobian[a, i] * inverse[i, b]
            total += value * value
    s.constants[1] = math.sqrt(total)
    for row in range(1, k + 1 + m):
        _bend(s, row)
    for row in range(k + 1):
        for col in range(row + 1):
            s.pairs[row, col] = s.pairs[col, row] = math.sqrt(_square(s, row, col))
        total = 0.0
        for a in range(m):
            total += _square(s, row, k + 1 + a)
        s.mixed[row] = math.sqrt(total)
    s.pairs[0, 0] = 0.0  # cancelled by D_1, but for its defect
    total = 0.0
    for a in range(m):
        for b in range(a + 1):
            total += (1.0 if a == b else 2.0) * _square(s, k + 1 + a, k + 1 + b)
    s.constants[0] = math.sqrt(total)
    for i in range(n):
        s.reach[i] = norm_of(inverse[i])


@njit(cache=True, nogil=True)
def _bend(s: Scratch, row: int) -> None:
    """Multiply the tensor by one direction."""
    m, n = s.tensor.shape[0], s.tensor.shape[1]
    for a in range(m):
        for i in range(n):
            value = 0.0
            for c in range(n):
                value += s.tensor[a, i, c] * s.directions[row, c]
            s.curved[a, row, i] = value


@njit(cache=True, nogil=True)
def _square(s: Scratch, row: int, col: int) -> float:
    """Return ``|H[D_row, D_col]|^2``; the tensor times ``D_row`` is in the scratch."""
    total = 0.0
    for a in range(s.tensor.shape[0]):
        value = 0.0
        for i in range(s.tensor.shape[1]):
            value += s.curved[a, row, i] * s.directions[col, i]
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
    m, n = s.model.jacobian.shape
    # lambda = (J W J^T)^-1 J t
    for a in range(m):
        value = 0.0
        for i in range(n):
            if is_free[i]:
                value += s.model.jacobian[a, i] * s.directions[0, i]
        s.buffer[a] = value
    cholesky_solve(s.gram, s.buffer)
    for i in range(n):
        out[i] = 0.0
        if not is_free[i]:
            continue
        value = 0.0
        for a in range(m):
            value += s.buffer[a] * s.curved[a, 0, i]
        if not chain.wraps[i]:
            value += limit_push(chain.lower[i], chain.upper[i], q[i]) * s.directions[0, i] ** 2
        out[i] = value
    # Project on the null space: z - A J z.
    for a in range(m):
        value = 0.0
        for i in range(n):
            value += s.model.jacobian[a, i] * out[i]
        s.buffer[a] = value
    total = 0.0
    for i in range(n):
        for a in range(m):
            out[i] -= s.inverse[i, a] * s.buffer[a]
        total += out[i] * out[i]
    scale = min(_SELF_MOTION_GAIN, cap / math.sqrt(total)) if total > 0.0 else 0.0
    for i in range(n):
        out[i] *= scale
