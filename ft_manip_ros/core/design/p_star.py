"""P*: global search in one dimension by a one-step Bayesian method, then Brent (Zilinskas).

The function is modelled as a Wiener process through the points seen so far: between two of them
its mean is the straight line and its variance that of a Brownian bridge. The next point is where
the expected improvement over the best value is largest. Where three neighbouring points bracket a
minimum that the model calls ordinary, Brent's method refines it, and the global search leaves
that bracket alone. Everything is written ask-and-tell, so that compiled and Python callers share
it; both minimise.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array

FIRST_POINTS = 6
_GOLDEN = 0.3819660112501051
_SQRT_HALF = 0.7071067811865476
_DENSITY = 0.3989422804014327


@njit(cache=True, nogil=True)
def insert(x: float, y: float, xs: Array, ys: Array, settled: Array, count: int) -> int:
    """Insert an observation into the sorted arrays; return the new count.

    ``settled[i]`` is 1 where the interval from point i to i+1 was refined and is left alone.
    """
    at = count
    while at > 0 and xs[at - 1] > x:
        xs[at], ys[at], settled[at] = xs[at - 1], ys[at - 1], settled[at - 1]
        at -= 1
    xs[at], ys[at] = x, y
    settled[at] = settled[at - 1] if at > 0 else 0.0
    return count + 1


@njit(cache=True, nogil=True)
def wiener_scale(xs: Array, ys: Array, count: int) -> float:
    """Maximum-likelihood variance per unit length of the Wiener model."""
    total = 0.0
    used = 0
    for i in range(count - 1):
        width = xs[i + 1] - xs[i]
        # Points that Brent's method put side by side say nothing about the process.
        if width > 1e-6 * (xs[count - 1] - xs[0]):
            total += (ys[i + 1] - ys[i]) ** 2 / width
            used += 1
    return total / used if used > 0 else 0.0


@njit(cache=True, nogil=True)
def propose(
    xs: Array, ys: Array, settled: Array, count: int, variance: float
) -> tuple[float, float]:
    """Point of largest expected improvement, and that improvement (0: nothing left to find)."""
    best = ys[0]
    for i in range(1, count):
        best = min(best, ys[i])
    found, gain = xs[0], 0.0
    for i in range(count - 1):
        width = xs[i + 1] - xs[i]
        if settled[i] > 0.0 or width < 1e-9:
            continue
        # The improvement is smooth with one peak in an interval: a short scan finds it closely
        # enough, as only the order of the observations depends on it.
        for k in range(1, 8):
            share = k / 8.0
            mean = ys[i] + share * (ys[i + 1] - ys[i])
            sigma = math.sqrt(variance * width * share * (1.0 - share))
            if sigma <= 0.0:
                continue
            z = (best - mean) / sigma
            cdf = 0.5 * math.erfc(-z * _SQRT_HALF)
            expected = (best - mean) * cdf + sigma * _DENSITY * math.exp(-0.5 * z * z)
            if expected > gain:
                gain = expected
                found = xs[i] + share * width
    return found, gain


@njit(cache=True, nogil=True)
def bracket(xs: Array, ys: Array, settled: Array, count: int, variance: float) -> int:
    """Middle of three neighbours that bracket a minimum worth refining, or -1.

    Worth it where the two rises are no larger than the model expects over such widths: the
    function is then smooth on the scale of the points, and a local method beats more sampling.
    """
    choice = -1
    for i in range(1, count - 1):
        if settled[i - 1] > 0.0 and settled[i] > 0.0:
            continue
        left, right = ys[i - 1] - ys[i], ys[i + 1] - ys[i]
        if left <= 0.0 or right <= 0.0:
            continue
        expected = math.sqrt(variance * (xs[i + 1] - xs[i - 1]))
        if left + right > 2.0 * expected:
            continue
        if choice < 0 or ys[i] < ys[choice]:
            choice = i
    return choice


@njit(cache=True, nogil=True)
def brent_start(a: float, x: float, b: float, y: float, state: Array) -> None:
    """Begin Brent's minimisation in the bracket a < x < b with value ``y`` at ``x``."""
    state[0], state[1] = a, b
    state[2], state[3], state[4] = x, x, x
    state[5], state[6], state[7] = y, y, y
    state[8] = state[9] = 0.0


@njit(cache=True, nogil=True)
def brent_ask(state: Array, tolerance: float) -> float:
    """Next point to evaluate, or NaN where the bracket is as small as ``tolerance``."""
    a, b, x, w, v = state[0], state[1], state[2], state[3], state[4]
    fx, fw, fv = state[5], state[6], state[7]
    middle = 0.5 * (a + b)
    if abs(x - middle) <= 2.0 * tolerance - 0.5 * (b - a):
        return math.nan
    step, before = state[8], state[9]
    parabola = False
    if abs(before) > tolerance:
        r = (x - w) * (fx - fv)
        q = (x - v) * (fx - fw)
        p = (x - v) * q - (x - w) * r
        q = 2.0 * (q - r)
        if q > 0.0:
            p = -p
        q = abs(q)
        if abs(p) < abs(0.5 * q * before) and p > q * (a - x) and p < q * (b - x):
            state[9] = step
            step = p / q
            parabola = True
            if (x + step) - a < 2.0 * tolerance or b - (x + step) < 2.0 * tolerance:
                step = tolerance if x < middle else -tolerance
    if not parabola:
        state[9] = (a - x) if x >= middle else (b - x)
        step = _GOLDEN * state[9]
    state[8] = step
    if abs(step) >= tolerance:
        return x + step
    return x + (tolerance if step > 0.0 else -tolerance)


@njit(cache=True, nogil=True)
def brent_tell(u: float, fu: float, state: Array) -> None:
    """Report the value at the point last asked for."""
    x, w, v = state[2], state[3], state[4]
    fx, fw, fv = state[5], state[6], state[7]
    if fu <= fx:
        if u >= x:
            state[0] = x
        else:
            state[1] = x
        state[4], state[7] = w, fw
        state[3], state[6] = x, fx
        state[2], state[5] = u, fu
        return
    if u < x:
        state[0] = u
    else:
        state[1] = u
    if fu <= fw or w == x:
        state[4], state[7] = w, fw
        state[3], state[6] = u, fu
    elif fu <= fv or v in (x, w):
        state[4], state[7] = u, fu


def p_star_minimise(
    f: Callable[[float], float],
    lower: float,
    upper: float,
    *,
    evaluations: int = 60,
    tolerance: float = 1e-3,
) -> tuple[float, float, int]:
    """Minimise ``f`` on [lower, upper].

    Parameters
    ----------
    evaluations
        Largest number of function values.
    tolerance
        Width to which Brent's method refines a minimum; the search also ends where the expected
        improvement falls below this share of the spread of the values seen.

    Returns
    -------
    x, value, evaluations
    """
    xs, ys, settled = (
        np.empty(evaluations + 1),
        np.empty(evaluations + 1),
        np.zeros(evaluations + 1),
    )
    brent: NDArray[np.float64] = np.zeros(10)
    count = 0
    for x in np.linspace(lower, upper, FIRST_POINTS):
        count = insert(float(x), f(float(x)), xs, ys, settled, count)
    while count < evaluations:
        variance = wiener_scale(xs, ys, count)
        middle = bracket(xs, ys, settled, count, variance)
        if middle > 0:
            left, right = xs[middle - 1], xs[middle + 1]
            brent_start(left, xs[middle], right, ys[middle], brent)
            while count < evaluations:
                x = brent_ask(brent, tolerance)
                if x != x:
                    break
                y = f(x)
                brent_tell(x, y, brent)
                count = insert(x, y, xs, ys, settled, count)
            for i in range(count - 1):
                if xs[i] >= left and xs[i + 1] <= right:
                    settled[i] = 1.0
            continue
        x, gain = propose(xs, ys, settled, count, variance)
        if gain <= 1e-3 * tolerance * (ys[:count].max() - ys[:count].min() + 1e-12):
            break
        count = insert(x, f(x), xs, ys, settled, count)
    best = int(np.argmin(ys[:count]))
    return float(xs[best]), float(ys[best]), count
