"""Compiled covering certificate: one posture proves a whole box of frozen angles.

At a posture x0 with the frozen joints at the box's centre, let J be the free joints' Jacobian,
A a right inverse of it, and take the family of postures::

    x(delta, y) = x0 + D_0 delta_0 + D_1 delta_0^2 + sum_j D_j delta_j + A y,    |y| <= rho

with ``D_j`` the tangents that hold the residual to first order and ``D_1`` the one that cancels
the second-order term of ``delta_0``. By Taylor's theorem ``F(x(delta, y)) = y + E`` with E bounded
by the start residual, the exact second derivative at x0 and a bound of the third over the box.
If ``|E| <= rho`` for all of the box, ``y -> y - F`` maps the ball into itself, so by Brouwer's
theorem some y makes F exactly zero: a posture that reaches the goal, for every frozen angle of
the box. If moreover no joint can meet a limit within the box, that posture is admissible.
A goal moved by s enters like a start residual larger by s, so the slack of the inequality is
the radius of a ball of goals that the same posture proves.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.ftws.local_model import LocalModel, hessian, make_model, third_order_bound
from ft_manip_ros.core.ftws.posture import cholesky_solve, limit_push
from ft_manip_ros.core.ftws.task_map import TaskArrays

# Every bound is inflated by these for rounding: see docs/ftws.md.
RELATIVE_ROUNDING = 1e-9
ABSOLUTE_ROUNDING = 1e-12
# Step along the self-motion per unit of gradient (rad).
SELF_MOTION_GAIN = 1.0


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
    scale = min(SELF_MOTION_GAIN, cap / math.sqrt(total)) if total > 0.0 else 0.0
    for i in range(n):
        out[i] *= scale


@njit(cache=True, nogil=True)
def error_bound(
    chain: ChainArrays, task: TaskArrays, halves: Array, rho: float, s: Scratch
) -> float:
    """Bound of |E| - |r0| over the box of frozen half-widths and the ball |y| <= rho.

    Leaves the largest change of each joint in ``s.box``.
    """
    k = halves.shape[0]
    n = s.box.shape[0]
    h = halves[0]
    for i in range(n):
        value = abs(s.directions[0, i]) * h + abs(s.directions[1, i]) * h * h
        for j in range(1, k):
            value += abs(s.directions[j + 1, i]) * halves[j]
        s.box[i] = value + s.reach[i] * rho
    second = s.constants[0] * rho * rho
    first = s.constants[1] * rho
    for a in range(k + 1):
        sa = h if a == 0 else (h * h if a == 1 else halves[a - 1])
        first += s.defects[a] * sa
        second += 2.0 * rho * s.mixed[a] * sa
        for b in range(k + 1):
            sb = h if b == 0 else (h * h if b == 1 else halves[b - 1])
            second += s.pairs[a, b] * sa * sb
    length = task.length if task.orientation_rows.shape[0] > 0 else 0.0
    third = third_order_bound(chain, s.model.distance, length, s.box)
    return (first + 0.5 * second + third / 6.0) * (1.0 + RELATIVE_ROUNDING)


@njit(cache=True, nogil=True)
def holds(
    chain: ChainArrays,
    task: TaskArrays,
    q: Array,
    is_free: NDArray[np.bool_],
    halves: Array,
    start: float,
    s: Scratch,
) -> float:
    """Smallest rho found that closes the certificate for the box, or -1.

    Parameters
    ----------
    halves : shape (k,)
        Half-widths of the box of frozen positions (rad or m).
    start : float
        ``|r0|`` plus the radius of the ball of goals to prove (m), rounding included.
    """
    rho = before = start
    wanted = 0.0
    for step in range(12):
        last = wanted
        wanted = start + error_bound(chain, task, halves, rho, s)
        for i in range(q.shape[0]):
            if is_free[i] and not chain.wraps[i]:
                if q[i] - s.box[i] < chain.lower[i] or q[i] + s.box[i] > chain.upper[i]:
                    return -1.0
        if wanted <= rho:
            return rho
        # The bound is convex in rho: extrapolate its secant to the fixed point, and beyond.
        slope = 0.2 if step == 0 else max((wanted - last) / (rho - before), 0.0)
        if slope >= 0.95 or not wanted < 4.0 * task.length:
            return -1.0
        before = rho
        rho += 1.15 * (wanted - rho) / (1.0 - slope)
    return -1.0


@njit(cache=True, nogil=True)
def widest(
    chain: ChainArrays,
    task: TaskArrays,
    q: Array,
    is_free: NDArray[np.bool_],
    halves: Array,
    start: float,
    guess: float,
    smallest: float,
    s: Scratch,
) -> float:
    """Largest half-width of the first frozen joint that the certificate was found to carry.

    ``halves[0]`` is used as scratch and left at the result; 0 when even ``smallest`` fails.
    """
    h = max(guess, smallest)
    halves[0] = h
    if holds(chain, task, q, is_free, halves, start, s) >= 0.0:
        for _ in range(12):
            halves[0] = h * 1.2
            if holds(chain, task, q, is_free, halves, start, s) < 0.0:
                break
            h = halves[0]
        halves[0] = h
        return h
    while h > smallest:
        h = max(h * 0.75, smallest)
        halves[0] = h
        if holds(chain, task, q, is_free, halves, start, s) >= 0.0:
            return h
    halves[0] = 0.0
    return 0.0


@njit(cache=True, nogil=True)
def within_tolerance(
    chain: ChainArrays,
    task: TaskArrays,
    q: Array,
    is_free: NDArray[np.bool_],
    halves: Array,
    start: float,
    guess: float,
    smallest: float,
    tolerance: float,
    s: Scratch,
) -> float:
    """Largest half-width over which the family with y = 0 itself stays within the tolerance.

    Where the Jacobian is singular (on the boundary of a ROD's work space) nothing can be
    corrected, but the tangent posture misses the goal only to higher order.
    """
    h = guess
    while h >= smallest:
        halves[0] = h
        if start + error_bound(chain, task, halves, 0.0, s) <= tolerance:
            inside = True
            for i in range(q.shape[0]):
                if is_free[i] and not chain.wraps[i]:
                    inside = inside and (
                        q[i] - s.box[i] >= chain.lower[i] and q[i] + s.box[i] <= chain.upper[i]
                    )
            if inside:
                return h
        h *= 0.6
    halves[0] = 0.0
    return 0.0


@njit(cache=True, nogil=True)
def slack(
    chain: ChainArrays,
    task: TaskArrays,
    q: Array,
    is_free: NDArray[np.bool_],
    halves: Array,
    start: float,
    s: Scratch,
) -> float:
    """Radius of goals (m), beyond what ``start`` holds already, that the box's proof carries.

    The largest s found with ``start + s + E(rho) <= rho``, over rho up to the limits.
    """
    best = 0.0
    rho = holds(chain, task, q, is_free, halves, start, s)
    if rho < 0.0:
        return 0.0
    rho = max(rho, 1e-9)
    for _ in range(40):
        room = rho - start - error_bound(chain, task, halves, rho, s)
        for i in range(q.shape[0]):
            if is_free[i] and not chain.wraps[i]:
                if q[i] - s.box[i] < chain.lower[i] or q[i] + s.box[i] > chain.upper[i]:
                    return best
        if room < best:
            break
        best = room
        rho *= 1.3
    return best
