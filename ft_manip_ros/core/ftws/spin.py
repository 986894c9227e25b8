"""Compiled closed form for the first free joint: the goal as a circle about its axis."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ftws.local_model import LocalModel
from ft_manip_ros.core.ftws.task_map import TaskArrays


@kernel
def spin_joint(chain: ChainArrays, task: TaskArrays, is_free: NDArray[np.bool_]) -> int:
    """First free joint if it is revolute and only the position counts, else -1."""
    if task.orientation_rows.shape[0] > 0:
        return -1
    for i in range(is_free.shape[0]):
        if is_free[i]:
            return -1 if chain.prismatic[i] else i
    return -1


@kernel
def turn_goal(goal: Array, spin: int, model: LocalModel, turned: Array) -> float:
    """Goal turned about the spin joint's axis to the tool's side; returns the tool's radius."""
    axes, origins, tip = model.axes, model.origins, model.tip
    zx, zy, zz = axes[spin, 0], axes[spin, 1], axes[spin, 2]
    ox, oy, oz = origins[spin, 0], origins[spin, 1], origins[spin, 2]
    tx, ty, tz = tip[0] - ox, tip[1] - oy, tip[2] - oz
    along = tx * zx + ty * zy + tz * zz
    tx, ty, tz = tx - along * zx, ty - along * zy, tz - along * zz
    radius = math.sqrt(tx * tx + ty * ty + tz * tz)
    gx, gy, gz = goal[0] - ox, goal[1] - oy, goal[2] - oz
    height = gx * zx + gy * zy + gz * zz
    gx, gy, gz = gx - height * zx, gy - height * zy, gz - height * zz
    goal_radius = math.sqrt(gx * gx + gy * gy + gz * gz)
    if radius < 1e-12:
        return 0.0
    ratio = goal_radius / radius
    turned[0] = ox + height * zx + ratio * tx
    turned[1] = oy + height * zy + ratio * ty
    turned[2] = oz + height * zz + ratio * tz
    return radius


@kernel
def unroll(aim: Array, spin: int, model: LocalModel, radius: float, u: Array) -> None:
    """World direction of ``aim``'s radial and axial parts about the spin axis."""
    axes, origins, tip = model.axes, model.origins, model.tip
    along = 0.0
    for a in range(3):
        along += (tip[a] - origins[spin, a]) * axes[spin, a]
    for a in range(3):
        z = axes[spin, a]
        radial = (tip[a] - origins[spin, a] - along * z) / radius
        u[a] = aim[0] * radial + aim[1] * z


@kernel
def _spread(
    chain: ChainArrays, spin: int, half: Array, model: LocalModel, radius: float, crude: float
) -> tuple[float, float]:
    """How near to the spin axis the tool comes over a box, and how far it goes round (m).

    Both along the centre's own directions: the first is negative beyond the axis.
    """
    prismatic, axes, linear, origins, tip = (
        chain.prismatic,
        model.axes,
        model.linear,
        model.origins,
        model.tip,
    )
    zx, zy, zz = axes[spin, 0], axes[spin, 1], axes[spin, 2]
    tx = tip[0] - origins[spin, 0]
    ty = tip[1] - origins[spin, 1]
    tz = tip[2] - origins[spin, 2]
    along = tx * zx + ty * zy + tz * zz
    rx = (tx - along * zx) / radius
    ry = (ty - along * zy) / radius
    rz = (tz - along * zz) / radius
    sx, sy, sz = zy * rz - zz * ry, zz * rx - zx * rz, zx * ry - zy * rx
    radial = sideways = total = 0.0
    for k in range(half.shape[0]):
        if half[k] > 0.0:
            lx, ly, lz = linear[k, 0], linear[k, 1], linear[k, 2]
            radial += abs(rx * lx + ry * ly + rz * lz) * half[k]
            sideways += abs(sx * lx + sy * ly + sz * lz) * half[k]
            if not prismatic[k]:
                total += half[k]
    remainder = crude * total  # bounds half the second derivative over the box
    nearest = radius - min(radial + remainder, crude)
    return nearest, min(sideways + remainder, crude)


@kernel
def circle_correction(
    chain: ChainArrays,
    spin: int,
    half: Array,
    model: LocalModel,
    u: Array,
    radius: float,
    crude: float,
) -> float:
    """Give back what projecting the tool's radius onto its direction at the centre gains.

    The distance to the goal circle depends on the tool's radius about the axis, which is convex
    in the tool's position: the projection bounds it from below. Where the tool is nearer to the
    axis than the goal an upper bound is needed: of ``sqrt(a^2 + b^2) - a``, which is largest where
    a, its part outwards, is smallest and b, the one sideways, is largest.
    """
    axes, origins, tip = model.axes, model.origins, model.tip
    along = outward = 0.0
    for a in range(3):
        along += (tip[a] - origins[spin, a]) * axes[spin, a]
    for a in range(3):
        across = tip[a] - origins[spin, a] - along * axes[spin, a]
        outward += u[a] * across / radius
    if outward >= 0.0:
        return 0.0
    nearest, sideways = _spread(chain, spin, half, model, radius, crude)
    return -outward * (math.sqrt(nearest * nearest + sideways * sideways) - nearest)


@kernel
def beyond_limits(
    chain: ChainArrays, goal: Array, spin: int, centre: Array, half: Array, model: LocalModel
) -> bool:
    """Whether nowhere in the box the spin joint can turn the tool to the goal's side.

    Then the nearest that it gets is at one of its limits, since the distance to the goal has a
    single minimum over a turn. Expects the model of `lower_bound` on the same box.
    """
    if chain.wraps[spin]:
        return False
    tip, origins = model.tip, model.origins
    zx, zy, zz = model.axes[spin, 0], model.axes[spin, 1], model.axes[spin, 2]
    ox, oy, oz = origins[spin, 0], origins[spin, 1], origins[spin, 2]
    tx, ty, tz = tip[0] - ox, tip[1] - oy, tip[2] - oz
    gx, gy, gz = goal[0] - ox, goal[1] - oy, goal[2] - oz
    t_along = tx * zx + ty * zy + tz * zz
    g_along = gx * zx + gy * zy + gz * zz
    tx, ty, tz = tx - t_along * zx, ty - t_along * zy, tz - t_along * zz
    gx, gy, gz = gx - g_along * zx, gy - g_along * zy, gz - g_along * zz
    radius = math.sqrt(tx * tx + ty * ty + tz * tz)
    if radius < 1e-12 or math.sqrt(gx * gx + gy * gy + gz * gz) < 1e-9:
        return False
    sine = zx * (ty * gz - tz * gy) + zy * (tz * gx - tx * gz) + zz * (tx * gy - ty * gx)
    turn = centre[spin] + math.atan2(sine, tx * gx + ty * gy + tz * gz)
    nearest, sideways = _spread(
        chain, spin, half, model, radius, crude_bound(chain, model.distance, 0.0, half)
    )
    if nearest <= sideways:
        return False
    width = math.asin(sideways / nearest) + 1e-9
    # The window turned so that it starts at or after the lower limit.
    start = turn - width
    start -= 2.0 * math.pi * math.floor((start - chain.lower[spin]) / (2.0 * math.pi))
    return start > chain.upper[spin] and start + 2.0 * width < chain.lower[spin] + 2.0 * math.pi


@kernel
def crude_bound(chain: ChainArrays, distance: Array, length: float, half: Array) -> float:
    """How far the residual can move over a box, from the tool's distances to the axes alone."""
    prismatic = chain.prismatic
    moved = 0.0
    total = 0.0
    for k in range(half.shape[0] - 1, -1, -1):
        if half[k] > 0.0:
            step = half[k] if prismatic[k] else (distance[k] + moved) * half[k]
            moved += step
            total += step
            if length > 0.0 and not prismatic[k]:
                total += math.hypot(step, length * half[k]) - step
    return total
