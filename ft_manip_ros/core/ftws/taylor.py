"""Compiled Taylor model of the residual along the directions that a certificate uses."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ftws.curve import follow
from ft_manip_ros.core.ftws.local_model import LocalModel, make_model
from ft_manip_ros.core.ftws.majorant import Majorant, begin, make_majorant
from ft_manip_ros.core.ftws.place_series import Series, make_series
from ft_manip_ros.core.ftws.slopes import bend, second_slope
from ft_manip_ros.core.ftws.task_map import TaskArrays
from ft_manip_ros.core.ftws.turn_series import CURVE
from ft_manip_ros.core.ftws.weighting import cholesky_solve, limit_push

# Step along the self-motion per unit of gradient (rad).
_SELF_MOTION_GAIN = 1.0


class Scratch(NamedTuple):
    """Arrays that the kernels share within one thread: n joints, m equations, k frozen.

    Rows of directions: the CURVE ones of the first frozen joint, then the others' tangents.
    """

    model: LocalModel
    series: Series
    majorant: Majorant
    weights: Array  # (n,)
    gram: Array  # (m, m)
    inverse: Array  # (n, m), A with zero rows for frozen joints
    directions: Array  # (CURVE+k-1, n)
    curved: Array  # (k, m, n), second derivative times the tangent of each frozen joint
    slope: Array  # (m, n)
    kept: Array  # (CURVE+2, n), of the piece accepted last: posture, curve, self-motion to take
    trial: Array  # (n,)
    reach: Array  # (n,), |A_i|
    other: Array  # (n,), largest change by the other frozen joints
    corrected: Array  # (n,), largest change by y
    box: Array  # (n,), largest change but by y
    pairs: Array  # (k, k), |H[D_a, D_b]| of the tangents, 0 where cancelled
    mixed: Array  # (k+1,), |H[D_a, A]|, then that of the second order along the curve
    defects: Array  # (CURVE+k-1,), what is left to cancel along each direction
    fixed: Array  # (4,), |J A - I|; at the width in hand: terms without y, its slope; |H[A, A]|
    fit: Array  # (2,), share of the width in hand that the bound, and the limits, seem to carry
    buffer: Array  # (m,)
    aims: Array  # (4, 6), directions that refutations project on
    split: Array  # (4, n), the box that a refutation has in hand


@njit(cache=True, nogil=True)
def make_scratch(n: int, m: int, k: int, oriented: bool) -> Scratch:
    """Allocate the scratch arrays."""
    rows = CURVE + k - 1
    return Scratch(
        make_model(n, m),
        make_series(n, oriented),
        make_majorant(n),
        np.zeros(n),
        np.zeros((m, m)),
        np.zeros((n, m)),
        np.zeros((rows, n)),
        np.zeros((k, m, n)),
        np.zeros((m, n)),
        np.zeros((CURVE + 2, n)),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros((k, k)),
        np.zeros(k + 1),
        np.zeros(rows),
        np.zeros(4),
        np.zeros(2),
        np.zeros(m),
        np.zeros((4, 6)),
        np.zeros((4, n)),
    )


@kernel
def build(
    chain: ChainArrays, task: TaskArrays, combo: NDArray[np.int64], balls: bool, s: Scratch
) -> None:
    """Directions, second-order norms and defects at the evaluated posture, into the scratch.

    Expects ``s.model`` and ``s.inverse`` of the posture (see `posture.correct`). With ``balls``
    also the norm of second order in y, which costs as much as a fifth of a certificate and
    matters where large corrections have to be proved.
    """
    jacobian, inverse, d, curved = s.model.jacobian, s.inverse, s.directions, s.curved
    pairs, mixed, defects, reach = s.pairs, s.mixed, s.defects, s.reach
    m, n = jacobian.shape
    k = combo.shape[0]
    for j in range(k):
        row = 0 if j == 0 else CURVE + j - 1
        for i in range(n):
            value = 0.0
            for a in range(m):
                value -= inverse[i, a] * jacobian[a, combo[j]]
            d[row, i] = value
        d[row, combo[j]] = 1.0
        bend(chain, task, s.model, d[row], curved[j])
        if j > 0:
            total = 0.0
            for a in range(m):
                value = 0.0
                for i in range(n):
                    value += jacobian[a, i] * d[row, i]
                total += value * value
            defects[row] = math.sqrt(total)
    for i in range(n):
        square = 0.0
        for a in range(m):
            square += inverse[i, a] * inverse[i, a]
        reach[i] = math.sqrt(square)
    follow(chain, task, s.model, inverse, d, defects, s.buffer, s.series)
    total = 0.0
    for a in range(m):
        for b in range(m):
            value = -1.0 if a == b else 0.0
            for i in range(n):
                value += jacobian[a, i] * inverse[i, b]
            total += value * value
    s.fixed[0] = math.sqrt(total)
    for j in range(k):
        mixed[j] = _norm_of_product(curved[j], inverse, m)
        for other in range(j):
            total = 0.0
            row = CURVE + j - 1
            for a in range(m):
                value = 0.0
                for i in range(n):
                    value += curved[other, a, i] * d[row, i]
                total += value * value
            pairs[j, other] = pairs[other, j] = math.sqrt(total)
        if j > 0:
            total = 0.0
            for a in range(m):
                value = 0.0
                for i in range(n):
                    value += curved[j, a, i] * d[CURVE + j - 1, i]
                total += value * value
            pairs[j, j] = math.sqrt(total)
    s.fixed[3] = _square_of_corrections(chain, task, s) if balls else -1.0
    second_slope(chain, task, s.model, s.series, s.slope)
    mixed[k] = _norm_of_product(s.slope, inverse, task.position_rows.shape[0])
    begin(chain, s.model.distance, d, s.majorant)


@kernel
def _square_of_corrections(chain: ChainArrays, task: TaskArrays, s: Scratch) -> float:
    """Frobenius norm of ``H[A, A]``."""
    inverse, slope, column = s.inverse, s.slope, s.box
    n, m = inverse.shape
    total = 0.0
    for b in range(m):
        for i in range(n):
            column[i] = inverse[i, b]
        bend(chain, task, s.model, column, slope)
        total += _norm_of_product(slope, inverse, m) ** 2
    return math.sqrt(total)


@kernel
def _norm_of_product(left: Array, right: Array, rows: int) -> float:
    """Frobenius norm of the first rows of ``left right``."""
    total = 0.0
    for a in range(rows):
        for b in range(right.shape[1]):
            value = 0.0
            for i in range(right.shape[0]):
                value += left[a, i] * right[i, b]
            total += value * value
    return math.sqrt(total)


@kernel
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
    wraps, lower, upper, work = chain.wraps, chain.lower, chain.upper, s.buffer
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
            value += work[a] * curved[0, a, i]
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
