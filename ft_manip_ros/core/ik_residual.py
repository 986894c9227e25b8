"""How far the tool misses a goal, as one weighted residual, and how the joints change it."""

from __future__ import annotations

import math

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ik_types import AXIS, POSITION, IkWork
from ft_manip_ros.core.kernels import drive, gather, sweep, turn_tool


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
