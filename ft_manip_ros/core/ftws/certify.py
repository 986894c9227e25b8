"""Compiled covering certificate: one posture proves a whole box of frozen angles.

At a posture x0 with the frozen joints at the box's centre, let J be the free joints' Jacobian,
A a right inverse of it, and take the family of postures::

    x(delta, y) = x0 + D_0 delta_0 + ... + D_3 delta_0^4 + sum_j D_j delta_j + A y

with ``|y| <= rho``, tangents that hold the residual to first order, and ``D_1`` to ``D_3`` that
cancel the second- to fourth-order terms of ``delta_0``. By Taylor's theorem
``F(x(delta, y)) = y + E`` with E bounded by the start residual, the exact coefficients of
lowest order that contain y or another frozen joint, and a bound of all others.
If ``|E| <= rho`` for all of the box, ``y -> y - F`` maps the ball into itself, so by Brouwer's
theorem some y makes F exactly zero: a posture that reaches the goal, for every frozen angle of
the box. If moreover no joint can meet a limit within the box, that posture is admissible.
A goal moved by s enters like a start residual larger by s, so the slack of the inequality is
the radius of a ball of goals that the same posture proves.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ftws.majorant import unknown, widen
from ft_manip_ros.core.ftws.task_map import TaskArrays
from ft_manip_ros.core.ftws.taylor import Scratch
from ft_manip_ros.core.ftws.turn_series import CURVE

# Every bound is inflated by these for rounding: see docs/ftws.md.
RELATIVE_ROUNDING = 1e-9
ABSOLUTE_ROUNDING = 1e-12
# Share of the extrapolated half-width to try, and least growth worth a try.
_CAUTION, _GROWTH = 0.97, 1.04
# A half-width is changed by no more than this at once, either way.
_LARGEST_GROWTH, _LARGEST_SHRINKING = 2.5, 0.3
_ATTEMPTS = 12


@kernel
def room(
    chain: ChainArrays, q: Array, is_free: NDArray[np.bool_], rho: float, s: Scratch
) -> float:
    """Smallest ratio of a free joint's distance to its limits and its largest change.

    At least 1 where no joint can meet a limit within the box and ``|y| <= rho``.
    """
    wraps, lower, upper, box, reach = chain.wraps, chain.lower, chain.upper, s.box, s.reach
    least = math.inf
    for i in range(q.shape[0]):
        if is_free[i] and not wraps[i]:
            slack = min(q[i] - lower[i], upper[i] - q[i])
            change = box[i] + reach[i] * rho
            if slack < least * change:
                least = slack / change
    return least


@kernel
def set_box(chain: ChainArrays, task: TaskArrays, halves: Array, s: Scratch) -> None:
    """Go to a box of frozen half-widths (k,): everything that does not depend on rho."""
    d, pairs, mixed, defects = s.directions, s.pairs, s.mixed, s.defects
    box, other, fixed = s.box, s.other, s.fixed
    k = halves.shape[0]
    h = halves[0]
    widen(chain, s.model.distance, d, h, s.majorant)
    for i in range(box.shape[0]):
        value = 0.0
        for row in range(CURVE - 1, -1, -1):
            value = h * (value + abs(d[row, i]))
        other[i] = 0.0
        for j in range(1, k):
            other[i] += abs(d[CURVE + j - 1, i]) * halves[j]
        box[i] = value + other[i]
    value = 0.0
    for row in range(CURVE - 1, -1, -1):
        value = h * (value + defects[row])
    slope = fixed[0] + h * (mixed[0] + h * mixed[k])
    for j in range(1, k):
        value += halves[j] * (defects[CURVE + j - 1] + h * pairs[0, j])
        slope += halves[j] * mixed[j]
        for i in range(1, k):
            value += 0.5 * halves[j] * halves[i] * pairs[j, i]
    fixed[1], fixed[2] = value, slope


@kernel
def error_bound(
    chain: ChainArrays, task: TaskArrays, halves: Array, rho: float, s: Scratch
) -> float:
    """Bound of |E| - |r0| over the box of `set_box` and the ball |y| <= rho."""
    reach, corrected, fixed = s.reach, s.corrected, s.fixed
    for i in range(reach.shape[0]):
        corrected[i] = reach[i] * rho
    length = task.length if task.orientation_rows.shape[0] > 0 else 0.0
    rest = unknown(
        chain, s.model.distance, s.directions, length, halves[0], s.other, corrected,
        fixed[3] >= 0.0, s.majorant,
    )  # fmt: skip
    known = fixed[1] + rho * (fixed[2] + 0.5 * rho * max(fixed[3], 0.0))
    return (known + rest) * (1.0 + RELATIVE_ROUNDING)


@kernel
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

    Notes
    -----
    With ``E = e + a rho + b rho^2 / 2``, the rho that satisfy ``start + E <= rho`` lie between
    two roots, and so does their harmonic mean ``2 (start + e) / (1 - a)`` whenever there are any.
    ``s.fit`` is left at the shares of the half-width that this model and the limits allow.
    """
    fit = s.fit
    set_box(chain, task, halves, s)
    least = start + error_bound(chain, task, halves, 0.0, s)
    fit[0] = fit[1] = 0.0
    if not least < task.length:
        return -1.0
    slope = s.fixed[2]
    rho = 2.0 * least
    closed = -1.0
    bend = 0.0
    for _ in range(3):
        wanted = start + error_bound(chain, task, halves, rho, s)
        if not wanted < 4.0 * task.length:
            return -1.0
        bend = max(2.0 * ((wanted - least) / rho - slope) / rho, 0.0)
        if wanted <= rho:
            closed = rho
            break
        better = 2.0 * least / (1.0 - slope - 0.5 * bend * rho) if slope < 1.0 else math.inf
        if not rho * 1.01 < better < 100.0 * least:
            break
        rho = better
    fit[0] = _share(start, least - start, slope, bend)
    if closed < 0.0:
        fit[1] = room(chain, q, is_free, least, s)
        return -1.0
    fit[1] = room(chain, q, is_free, closed, s)
    if fit[1] < 1.0:
        # The smaller root moves the joints less.
        gap = (1.0 - slope) ** 2 - 2.0 * bend * least
        rho = 1.02 * 2.0 * least / (1.0 - slope + math.sqrt(max(gap, 0.0)))
        if rho < closed and start + error_bound(chain, task, halves, rho, s) <= rho:
            closed = rho
            fit[1] = room(chain, q, is_free, closed, s)
        if fit[1] < 1.0:
            return -1.0
    return closed


@kernel
def _share(start: float, error: float, slope: float, bend: float) -> float:
    """Factor on the half-width up to which the model of `holds` has a solution, with E ~ h^5."""
    low, high = 0.0, _LARGEST_GROWTH
    for _ in range(9):
        factor = 0.5 * (low + high)
        square = factor * factor
        gap = 1.0 - slope * factor
        if gap > 0.0 and gap * gap > 2.0 * bend * (start + error * square * square * factor):
            low = factor
        else:
            high = factor
    return low


@kernel
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
    best, failed = 0.0, math.inf
    for _ in range(_ATTEMPTS):
        halves[0] = h
        if holds(chain, task, q, is_free, halves, start, s) >= 0.0:
            best = h
        else:
            failed = h
            if best > 0.0 or h <= smallest:
                break
        factor = min(_CAUTION * min(s.fit[0], s.fit[1]), _LARGEST_GROWTH)
        if best > 0.0:
            if factor < _GROWTH or best * _GROWTH > failed:
                break
            h = min(best * factor, 0.5 * (best + failed))
        else:
            h = max(h * min(max(factor, _LARGEST_SHRINKING), 0.9), smallest)
    halves[0] = best
    return best


@kernel
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
        set_box(chain, task, halves, s)
        missed = start + error_bound(chain, task, halves, 0.0, s)
        if missed <= tolerance and room(chain, q, is_free, 0.0, s) >= 1.0:
            return h
        h *= 0.6
    halves[0] = 0.0
    return 0.0
