"""Levenberg-Marquardt descent on the tool's whole frame or axis, inside the joint limits."""

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
    STALLED,
    IkControl,
    IkWork,
)

# As in `ik_position`; the rotation's second-order terms make longer patience worth it.
DAMPING = 0.1
FLOOR = 1e-12
WINDOW = 6
RATIO = 0.25


@kernel
def solve6(a: Array, b: Array) -> None:
    """Solve a symmetric positive definite 6 x 6 system in place (lower triangle of ``a``)."""
    for j in range(6):
        d = a[j, j]
        for k in range(j):
            d -= a[j, k] * a[j, k]
        d = 1.0 / math.sqrt(max(d, 1e-300))
        a[j, j] = d
        for i in range(j + 1, 6):
            s = a[i, j]
            for k in range(j):
                s -= a[i, k] * a[j, k]
            a[i, j] = s * d
    for j in range(6):
        s = b[j]
        for k in range(j):
            s -= a[j, k] * b[k]
        b[j] = s * a[j, j]
    for j in range(5, -1, -1):
        s = b[j]
        for k in range(j + 1, 6):
            s -= a[k, j] * b[k]
        b[j] = s * a[j, j]


@kernel
def bounded_step(
    chain: ChainArrays, frozen: NDArray[np.bool_], q: Array, damping: float, work: IkWork
) -> None:
    """Write the damped least-norm step inside the limits, as `ik_position` describes it."""
    wraps, lower, upper = chain.wraps, chain.lower, chain.upper
    columns, step, free = work.columns, work.step, work.free
    gram, right, residual = work.gram, work.multiplier, work.residual
    n = q.shape[0]
    for i in range(n):
        step[i] = 0.0
        free[i] = not frozen[i]
        if free[i] and not wraps[i] and (q[i] <= lower[i] or q[i] >= upper[i]):
            gradient = 0.0
            for a in range(6):
                gradient += columns[i, a] * residual[a]
            free[i] = gradient > 0.0 if q[i] <= lower[i] else gradient < 0.0
    for _ in range(n):
        for a in range(6):
            for b in range(a):
                gram[a, b] = 0.0
            gram[a, a] = damping
            right[a] = residual[a]
        for i in range(n):
            if free[i]:
                for a in range(6):
                    c = columns[i, a]
                    for b in range(a + 1):
                        gram[a, b] += c * columns[i, b]
            elif step[i] != 0.0:
                for a in range(6):
                    right[a] -= columns[i, a] * step[i]
        solve6(gram, right)
        inside = True
        for i in range(n):
            if not free[i]:
                continue
            s = 0.0
            for a in range(6):
                s += columns[i, a] * right[a]
            if not wraps[i]:
                low, high = lower[i] - q[i], upper[i] - q[i]
                if s < low or s > high:
                    s = low if s < low else high
                    inside = False
                    free[i] = False
            step[i] = s
        if inside:
            return


@kernel
def descend_pose(
    chain: ChainArrays,
    frozen: NDArray[np.bool_],
    mode: int,
    target: Array,
    target_rotation: Array,
    control: IkControl,
    q: Array,
    work: IkWork,
) -> tuple[int, int, float, float]:
    """Move ``q`` (n,) towards the target frame; returns status, steps taken and errors (m, rad).

    As `ik_position.descend_position`, for mode `AXIS` or `POSE`; also for mode `POSITION` of
    arms with mimic joints, for which that one is not made.
    """
    n = q.shape[0]
    weight = control.weight
    mark = np.inf
    steps, judged = 0, 0
    while True:
        distance, angle = pose_error(chain, mode, target, target_rotation, weight, q, work)
        if distance <= control.tolerance and angle <= control.orientation_tolerance:
            return CONVERGED, steps, distance, angle
        cost = distance * distance + (weight * angle) ** 2
        if steps == judged:
            # Written so that overflow and NaN also end the descent.
            if not (cost <= RATIO * mark and cost < np.inf):
                return STALLED, steps, distance, angle
            mark = cost
            judged += WINDOW
        if steps >= control.max_iterations:
            return ITERATION_LIMIT, steps, distance, angle
        steps += 1
        weighted_columns(chain, mode, target, weight, work)
        bounded_step(chain, frozen, q, DAMPING * cost + FLOOR, work)
        for i in range(n):
            if not frozen[i]:
                q[i] += work.step[i]
                if not chain.wraps[i]:
                    q[i] = min(max(q[i], chain.lower[i]), chain.upper[i])
