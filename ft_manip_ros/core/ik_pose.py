"""Levenberg-Marquardt descent on the tool's whole frame or axis, inside the joint limits."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ik_types import (
    AXIS,
    CONVERGED,
    ITERATION_LIMIT,
    POSITION,
    STALLED,
    IkControl,
    IkWork,
)
from ft_manip_ros.core.kernels import drive, gather, sweep, turn_tool

# As in `ik_position`; the rotation's second-order terms make longer patience worth it.
DAMPING = 0.1
FLOOR = 1e-12
WINDOW = 6
RATIO = 0.25


@kernel
def rotation_error(actual: Array, target: Array, mode: int, out: Array) -> float:
    """Write the rotation vector from actual to target frame to ``out[3:6]``; return its angle.

    Mode `POSE`: in the base frame. Mode `AXIS`: the smallest rotation that brings z onto the
    target's z, in the tool frame, where its third component is zero: turning about the tool
    axis changes nothing.
    """
    if mode == AXIS:
        # The target's z axis seen from the tool.
        tx = (
            actual[0, 0] * target[0, 2] + actual[1, 0] * target[1, 2] + actual[2, 0] * target[2, 2]
        )
        ty = (
            actual[0, 1] * target[0, 2] + actual[1, 1] * target[1, 2] + actual[2, 1] * target[2, 2]
        )
        cosine = (
            actual[0, 2] * target[0, 2] + actual[1, 2] * target[1, 2] + actual[2, 2] * target[2, 2]
        )
        vx, vy, vz = -ty, tx, 0.0
    else:
        vx, vy, vz, trace = 0.0, 0.0, 0.0, 0.0
        for k in range(3):
            a0, a1, a2 = actual[0, k], actual[1, k], actual[2, k]
            b0, b1, b2 = target[0, k], target[1, k], target[2, k]
            vx += a1 * b2 - a2 * b1
            vy += a2 * b0 - a0 * b2
            vz += a0 * b1 - a1 * b0
            trace += a0 * b0 + a1 * b1 + a2 * b2
        vx, vy, vz = 0.5 * vx, 0.5 * vy, 0.5 * vz
        cosine = 0.5 * (trace - 1.0)
    sine = math.sqrt(vx * vx + vy * vy + vz * vz)
    angle = math.atan2(sine, cosine)
    if sine > 1e-9:
        factor = angle / sine
        out[3], out[4], out[5] = vx * factor, vy * factor, vz * factor
    elif cosine > 0.0:
        out[3], out[4], out[5] = vx, vy, vz
    else:
        # Half a turn off: no axis is better than another.
        out[3], out[4], out[5] = angle, 0.0, 0.0
    return angle


@kernel
def pose_error(
    chain: ChainArrays,
    mode: int,
    target: Array,
    target_rotation: Array,
    weight: float,
    q: Array,
    work: IkWork,
) -> tuple[float, float]:
    """Write the weighted residual at ``q``; return position error (m), orientation error (rad).

    In mode `POSITION` the orientation's part of it is zero.
    """
    if chain.driver.shape[0] > 0:
        drive(chain.driver, chain.ratio, q, work.positions)
        q = work.positions
    place, turned = sweep(
        chain.rotations,
        chain.translations,
        chain.screws,
        chain.prismatic,
        q,
        work.axes,
        work.origins,
    )
    r = work.residual
    r[0], r[1], r[2] = target[0] - place[0], target[1] - place[1], target[2] - place[2]
    distance = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    if mode == POSITION:
        r[3], r[4], r[5] = 0.0, 0.0, 0.0
        return distance, 0.0
    turn_tool(chain.rotations, turned, work.rotation)
    angle = rotation_error(work.rotation, target_rotation, mode, r)
    r[3] *= weight
    r[4] *= weight
    r[5] *= weight
    return distance, angle


@kernel
def weighted_columns(
    chain: ChainArrays, mode: int, target: Array, weight: float, work: IkWork
) -> None:
    """Write the weighted Jacobian, one joint a row, at the posture of the last `pose_error`."""
    r, rotation, prismatic = work.residual, work.rotation, chain.prismatic
    coupled = chain.driver.shape[0] > 0
    axes, origins = work.axes, work.origins
    columns = work.wide if coupled else work.columns
    x, y, z = target[0] - r[0], target[1] - r[1], target[2] - r[2]
    for i in range(axes.shape[0]):
        u, v, w = axes[i, 0], axes[i, 1], axes[i, 2]
        if prismatic[i]:
            columns[i, 0], columns[i, 1], columns[i, 2] = u, v, w
            columns[i, 3], columns[i, 4], columns[i, 5] = 0.0, 0.0, 0.0
            continue
        dx, dy, dz = x - origins[i, 0], y - origins[i, 1], z - origins[i, 2]
        columns[i, 0], columns[i, 1], columns[i, 2] = (
            v * dz - w * dy,
            w * dx - u * dz,
            u * dy - v * dx,
        )
        if mode == AXIS:
            columns[i, 3] = weight * (rotation[0, 0] * u + rotation[1, 0] * v + rotation[2, 0] * w)
            columns[i, 4] = weight * (rotation[0, 1] * u + rotation[1, 1] * v + rotation[2, 1] * w)
            columns[i, 5] = 0.0
        elif mode == POSITION:
            columns[i, 3], columns[i, 4], columns[i, 5] = 0.0, 0.0, 0.0
        else:
            columns[i, 3], columns[i, 4], columns[i, 5] = weight * u, weight * v, weight * w
    if coupled:
        gather(chain.driver, chain.ratio, columns, work.columns)


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
