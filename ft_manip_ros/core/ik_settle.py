"""Careful descent to a local minimum: for goals that no restart reached, an honest residual."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ik_residual import pose_error, weighted_columns
from ft_manip_ros.core.ik_types import (
    CONVERGED,
    ITERATION_LIMIT,
    LOCAL_MINIMUM,
    POSITION,
    IkControl,
    IkWork,
)

# Steps after which settling is given up.
_MOST_STEPS = 100
# A minimum is reached where the best step promises less than this part of the squared error,
# or where rounding leaves steps this small (rad or m) without gain.
_PROMISE = 1e-12
_SMALLEST_STEP = 1e-9


@kernel
def _cost(
    chain: ChainArrays,
    mode: int,
    target: Array,
    rotation: Array,
    weight: float,
    q: Array,
    work: IkWork,
) -> tuple[float, float, float]:
    """Squared weighted error at ``q`` and its parts; the residual is left in ``work``."""
    distance, angle = pose_error(chain, mode, target, rotation, weight, q, work)
    return distance * distance + (weight * angle) ** 2, distance, angle


@kernel
def _second_order(
    chain: ChainArrays, frozen: NDArray[np.bool_], mode: int, q: Array, work: IkWork
) -> float:
    """Write gradient (in ``step``) and Hessian of half the cost; returns its largest entry.

    The Hessian is J^T J minus the curvature of the position, r . d2p/dq_i dq_j with
    d2p/dq_i dq_j = z_i x J_j for i <= j; that of the rotation is left out. Joints that may not
    move get a row of the identity. The strict upper triangle and ``diagonal`` hold it.
    """
    n = q.shape[0]
    r, columns, h, g = work.residual, work.columns, work.hessian, work.step
    rows = 3 if mode == POSITION else 6
    coupled = chain.driver.shape[0] > 0
    largest = 0.0
    for i in range(n):
        g[i] = 0.0
        work.free[i] = not frozen[i]
        for a in range(rows):
            g[i] -= columns[i, a] * r[a]
        if not chain.wraps[i] and (
            (q[i] <= chain.lower[i] and g[i] > 0.0) or (q[i] >= chain.upper[i] and g[i] < 0.0)
        ):
            work.free[i] = False
        if not work.free[i]:
            g[i] = 0.0
    for i in range(n):
        for j in range(i, n):
            s = 0.0
            if work.free[i] and work.free[j]:
                for a in range(rows):
                    s += columns[i, a] * columns[j, a]
                if not coupled and not chain.prismatic[i]:
                    x, y, z = work.axes[i]
                    u, v, w = columns[j, 0], columns[j, 1], columns[j, 2]
                    s -= r[0] * (y * w - z * v) + r[1] * (z * u - x * w) + r[2] * (x * v - y * u)
            if i < j:
                h[i, j] = s
            else:
                work.diagonal[i] = s if work.free[i] else 1.0
    if coupled:
        _coupled_curvature(chain, work)
    for i in range(n):
        for j in range(i, n):
            # Overflow and NaN count as infinite; joints that may not move do not count.
            s = abs(h[i, j]) if i < j else abs(work.diagonal[i]) * work.free[i]
            largest = max(largest, s) if s < np.inf else np.inf
    return largest


@kernel
def _coupled_curvature(chain: ChainArrays, work: IkWork) -> None:
    """Take the position's curvature, as `_second_order` has it, from the Hessian: of all axes.

    The second derivative of two axes counts for the joints that drive them; for two axes of one
    joint it does so twice.
    """
    r, wide, driver, ratio = work.residual, work.wide, chain.driver, chain.ratio
    for i in range(driver.shape[0]):
        if chain.prismatic[i] or not work.free[driver[i]]:
            continue
        x, y, z = work.axes[i]
        for j in range(i, driver.shape[0]):
            if not work.free[driver[j]]:
                continue
            u, v, w = wide[j, 0], wide[j, 1], wide[j, 2]
            s = r[0] * (y * w - z * v) + r[1] * (z * u - x * w) + r[2] * (x * v - y * u)
            s *= ratio[i] * ratio[j]
            a, b = driver[i], driver[j]
            if a == b:
                work.diagonal[a] -= s if i == j else 2.0 * s
            else:
                work.hessian[min(a, b), max(a, b)] -= s


@kernel
def _newton_step(shift: float, work: IkWork) -> bool:
    """Turn the gradient in ``step`` into the shifted Newton step; False if not a descent."""
    h = work.hessian
    n = h.shape[0]
    for j in range(n):
        d = work.diagonal[j] + shift
        for k in range(j):
            d -= h[j, k] * h[j, k]
        if not d > 1e-14 * (abs(work.diagonal[j]) + shift):
            return False
        d = math.sqrt(d)
        work.pivots[j] = d
        for i in range(j + 1, n):
            s = h[j, i]
            for k in range(j):
                s -= h[i, k] * h[j, k]
            h[i, j] = s / d
    b = work.step
    for j in range(n):
        s = -b[j]
        for k in range(j):
            s -= h[j, k] * b[k]
        b[j] = s / work.pivots[j]
    for j in range(n - 1, -1, -1):
        s = b[j]
        for k in range(j + 1, n):
            s -= h[k, j] * b[k]
        b[j] = s / work.pivots[j]
    return True


@kernel
def settle(
    chain: ChainArrays,
    frozen: NDArray[np.bool_],
    mode: int,
    target: Array,
    rotation: Array,
    control: IkControl,
    q: Array,
    work: IkWork,
) -> tuple[int, int, float, float]:
    """Follow the cost downhill from ``q`` (n,), never up; returns status, steps and errors.

    Newton steps with a shift that grows until they descend. Unlike the fast descents it ends
    at a local minimum also where the goal stays out of reach. Status is `CONVERGED`,
    `LOCAL_MINIMUM` or `ITERATION_LIMIT`.
    """
    n = q.shape[0]
    weight = control.weight
    cost, distance, angle = _cost(chain, mode, target, rotation, weight, q, work)
    shift = 0.0
    steps = 0
    fresh = True
    largest = 0.0
    while True:
        if distance <= control.tolerance and angle <= control.orientation_tolerance:
            return CONVERGED, steps, distance, angle
        if steps >= _MOST_STEPS:
            return ITERATION_LIMIT, steps, distance, angle
        steps += 1
        # A refused trial has overwritten the residual and the axes.
        if not fresh:
            _cost(chain, mode, target, rotation, weight, q, work)
        weighted_columns(chain, mode, target, weight, work)
        largest = _second_order(chain, frozen, mode, q, work)
        if largest == 0.0:
            return LOCAL_MINIMUM, steps, distance, angle
        if not (cost < np.inf and largest < np.inf):
            return ITERATION_LIMIT, steps, distance, angle
        for i in range(n):
            work.trial[i] = work.step[i]
        # Ends, since a shift beyond all entries makes any matrix positive definite.
        while not _newton_step(shift, work):
            shift = max(4.0 * shift, 1e-4 * largest)
            for i in range(n):
                work.step[i] = work.trial[i]
        promise, longest = 0.0, 0.0
        for i in range(n):
            gradient = work.trial[i]
            work.trial[i] = q[i] + work.step[i]
            if not chain.wraps[i] and not frozen[i]:
                work.trial[i] = min(max(work.trial[i], chain.lower[i]), chain.upper[i])
            moved = work.trial[i] - q[i]
            promise -= gradient * moved
            longest = max(longest, abs(moved))
        if promise <= _PROMISE * cost:
            return LOCAL_MINIMUM, steps, distance, angle
        new_cost, d, a = _cost(chain, mode, target, rotation, weight, work.trial, work)
        fresh = new_cost < cost
        if fresh:
            cost, distance, angle = new_cost, d, a
            for i in range(n):
                q[i] = work.trial[i]
            shift = shift / 8.0 if shift > 1e-10 * largest else 0.0
        elif longest < _SMALLEST_STEP:
            return LOCAL_MINIMUM, steps, distance, angle
        else:
            shift = max(4.0 * shift, 1e-4 * largest)
