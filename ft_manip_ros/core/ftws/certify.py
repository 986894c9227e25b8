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

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.ftws.local_model import third_order_bound
from ft_manip_ros.core.ftws.task_map import TaskArrays
from ft_manip_ros.core.ftws.taylor import Scratch

# Every bound is inflated by these for rounding: see docs/ftws.md.
RELATIVE_ROUNDING = 1e-9
ABSOLUTE_ROUNDING = 1e-12


@njit(cache=True, nogil=True)
def inside_limits(chain: ChainArrays, q: Array, is_free: NDArray[np.bool_], box: Array) -> bool:
    """Whether no free joint can meet a limit within ``box`` (n,) around ``q``."""
    for i in range(q.shape[0]):
        if (
            is_free[i]
            and not chain.wraps[i]
            and (q[i] - box[i] < chain.lower[i] or q[i] + box[i] > chain.upper[i])
        ):
            return False
    return True


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
        missed = start + error_bound(chain, task, halves, 0.0, s)
        if missed <= tolerance and inside_limits(chain, q, is_free, s.box):
            return h
        h *= 0.6
    halves[0] = 0.0
    return 0.0
