"""Compiled covering certificate: one posture proves a whole box of frozen angles.

At a posture x0 with the frozen joints at the box's centre, let J be the free joints' Jacobian,
A a right inverse of it, and take the family of postures::

    x(delta, y) = x0 + D_0 delta_0 + D_1 delta_0^2 + D_2 delta_0^3 + sum_j D_j delta_j + A y

with ``|y| <= rho``, tangents that hold the residual to first order, and ``D_1`` and ``D_2`` that
cancel the second- and third-order terms of ``delta_0``. By Taylor's theorem
``F(x(delta, y)) = y + E`` with E bounded by the start residual, the exact second derivative at
x0, bounds of the third one's other terms, and a bound of the fourth one over the box.
If ``|E| <= rho`` for all of the box, ``y -> y - F`` maps the ball into itself, so by Brouwer's
theorem some y makes F exactly zero: a posture that reaches the goal, for every frozen angle of
the box. If moreover no joint can meet a limit within the box, that posture is admissible.
A goal moved by s enters like a start residual larger by s, so the slack of the inequality is
the radius of a ball of goals that the same posture proves.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.ftws.remainder import beyond_line
from ft_manip_ros.core.ftws.task_map import TaskArrays
from ft_manip_ros.core.ftws.taylor import CURVE, Scratch

# Every bound is inflated by these for rounding: see docs/ftws.md.
RELATIVE_ROUNDING = 1e-9
ABSOLUTE_ROUNDING = 1e-12
# Growth and shrinking of a half-width between attempts.
_GROWTH = 1.15
_SHRINKING = 0.9


@njit(cache=True, nogil=True)
def inside_limits(chain: ChainArrays, q: Array, is_free: NDArray[np.bool_], box: Array) -> bool:
    """Whether no free joint can meet a limit within ``box`` (n,) around ``q``."""
    wraps, lower, upper = chain.wraps, chain.lower, chain.upper
    for i in range(q.shape[0]):
        if is_free[i] and not wraps[i] and (q[i] - box[i] < lower[i] or q[i] + box[i] > upper[i]):
            return False
    return True


@njit(cache=True, nogil=True)
def error_bound(
    chain: ChainArrays, task: TaskArrays, halves: Array, rho: float, s: Scratch
) -> float:
    """Bound of |E| - |r0| over the box of frozen half-widths and the ball |y| <= rho.

    Leaves the largest change of each joint in ``s.box``.
    """
    d, pairs, mixed, defects = s.directions, s.pairs, s.mixed, s.defects
    line, box, reach, powers = s.line, s.box, s.reach, s.powers
    rows = powers.shape[0]
    h = halves[0]
    powers[0], powers[1], powers[2] = h, h * h, h * h * h
    for row in range(CURVE, rows):
        powers[row] = halves[row - CURVE + 1]
    for i in range(box.shape[0]):
        line[i] = abs(d[0, i]) * h
        value = line[i] + reach[i] * rho
        for row in range(1, rows):
            value += abs(d[row, i]) * powers[row]
        box[i] = value
    second = s.constants[0] * rho * rho
    first = s.constants[1] * rho
    for a in range(rows):
        first += defects[a] * powers[a]
        value = 2.0 * rho * mixed[a]
        for b in range(rows):
            value += pairs[a, b] * powers[b]
        second += value * powers[a]
    length = task.length if task.orientation_rows.shape[0] > 0 else 0.0
    rest = beyond_line(chain, s.model.distance, length, line, box)
    return (first + 0.5 * second + rest) * (1.0 + RELATIVE_ROUNDING)


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
        if not inside_limits(chain, q, is_free, s.box):
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
        for _ in range(16):
            halves[0] = h * _GROWTH
            if holds(chain, task, q, is_free, halves, start, s) < 0.0:
                break
            h = halves[0]
        halves[0] = h
        return h
    factor = _SHRINKING
    while h > smallest:
        h = max(h * factor, smallest)
        halves[0] = h
        if holds(chain, task, q, is_free, halves, start, s) >= 0.0:
            return h
        factor = max(factor * _SHRINKING, 0.4)
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
        missed = start + error_bound(chain, task, halves, 0.0, s)
        if missed <= tolerance and inside_limits(chain, q, is_free, s.box):
            return h
        h *= 0.6
    halves[0] = 0.0
    return 0.0
