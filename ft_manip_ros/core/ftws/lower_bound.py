"""Compiled lower bounds of the residual over boxes of postures.

On a box of postures around c, with u any unit vector::

    |F(c + d)| >= u . F(c + d) >= u . F(c) + sum_i g_i d_i + 1/2 sum_ik H_ik d_i d_k - T / 6

with the exact gradient g and Hessian H of ``u . F`` at c and a bound T of the third derivative
over the box. The first free joint, if revolute, is minimised in closed form: the goal becomes a
circle about its axis and the box loses a dimension. Where that joint has limits, the circle is a
relaxation, and boxes that would need it beyond them are judged at its limits instead.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.ftws.certify import ABSOLUTE_ROUNDING
from ft_manip_ros.core.ftws.local_model import LocalModel, evaluate, third_order_bound
from ft_manip_ros.core.ftws.task_map import TaskArrays


@njit(cache=True, nogil=True)
def spin_joint(chain: ChainArrays, task: TaskArrays, is_free: NDArray[np.bool_]) -> int:
    """First free joint if it is revolute and only the position counts, else -1."""
    if task.orientation_rows.shape[0] > 0:
        return -1
    for i in range(is_free.shape[0]):
        if is_free[i]:
            return -1 if chain.prismatic[i] else i
    return -1


@njit(cache=True, nogil=True)
def _turn_goal(goal: Array, spin: int, model: LocalModel, turned: Array) -> float:
    """Goal turned about the spin joint's axis to the tool's side; returns the tool's radius."""
    zx, zy, zz = model.axes[spin, 0], model.axes[spin, 1], model.axes[spin, 2]
    ox, oy, oz = model.origins[spin, 0], model.origins[spin, 1], model.origins[spin, 2]
    tx, ty, tz = model.tip[0] - ox, model.tip[1] - oy, model.tip[2] - oz
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


@njit(cache=True, nogil=True)
def _crude(
    chain: ChainArrays, distance: Array, length: float, half: Array
) -> float:
    """How far the residual can move over a box, from the tool's distances to the axes alone."""
    moved = 0.0
    total = 0.0
    for k in range(half.shape[0] - 1, -1, -1):
        if half[k] > 0.0:
            step = half[k] if chain.prismatic[k] else (distance[k] + moved) * half[k]
            moved += step
            total += step
            if length > 0.0 and not chain.prismatic[k]:
                total += math.hypot(step, length * half[k]) - step
    return total


@njit(cache=True, nogil=True)
def _along(
    chain: ChainArrays,
    task: TaskArrays,
    u: Array,
    half: Array,
    model: LocalModel,
    share: Array,
) -> float:
    """Largest decrease of ``u . F`` over a box by its gradient and Hessian; ``share`` (n,) out.

    ``u`` (6,): direction in the world's position coordinates, then in the orientation's,
    scaled by the task's length.
    """
    n = half.shape[0]
    mp = task.position_rows.shape[0]
    mo = task.orientation_rows.shape[0]
    ux, uy, uz = u[0], u[1], u[2]
    w, ex, ey, ez = model.error[0], model.error[1], model.error[2], model.error[3]
    vx, vy, vz = u[3], u[4], u[5]
    along = 0.5 * (ex * vx + ey * vy + ez * vz)
    sx = 0.5 * (w * vx + ey * vz - ez * vy)
    sy = 0.5 * (w * vy + ez * vx - ex * vz)
    sz = 0.5 * (w * vz + ex * vy - ey * vx)
    cost_total = 0.0
    for i in range(n):
        share[i] = 0.0
    for k in range(n):
        hk = half[k]
        if hk == 0.0:
            continue
        lx, ly, lz = model.linear[k, 0], model.linear[k, 1], model.linear[k, 2]
        kx, ky, kz = model.axes[k, 0], model.axes[k, 1], model.axes[k, 2]
        gradient = ux * lx + uy * ly + uz * lz
        if mo > 0 and not chain.prismatic[k]:
            gradient += 2.0 * (sx * kx + sy * ky + sz * kz)
        gradient = abs(gradient)
        for i in range(k + 1):
            if half[i] == 0.0 or chain.prismatic[i]:
                continue
            ax, ay, az = model.axes[i, 0], model.axes[i, 1], model.axes[i, 2]
            curvature = (
                (uy * az - uz * ay) * lx + (uz * ax - ux * az) * ly + (ux * ay - uy * ax) * lz
            )
            if mo > 0 and not chain.prismatic[k]:
                curvature += (
                    (ay * kz - az * ky) * sx + (az * kx - ax * kz) * sy + (ax * ky - ay * kx) * sz
                ) - (ax * kx + ay * ky + az * kz) * along
            if i < k:
                cost = abs(curvature) * half[i] * hk
                share[i] += 0.5 * cost
                share[k] += 0.5 * cost
            else:
                if curvature > 0.0 and gradient < curvature * hk:
                    cost = 0.5 * gradient * gradient / curvature
                else:
                    cost = gradient * hk - 0.5 * curvature * hk * hk
                share[k] += cost
            cost_total += cost
        if chain.prismatic[k]:
            share[k] += gradient * hk
            cost_total += gradient * hk
    return cost_total


@njit(cache=True, nogil=True)
def lower_bound(
    chain: ChainArrays,
    task: TaskArrays,
    goal: Array,
    spin: int,
    centre: Array,
    half: Array,
    aim: Array,
    model: LocalModel,
    spare: Array,
    share: Array,
) -> tuple[float, float]:
    """Proved lower bound of the residual over a box, and the residual at its centre (m).

    Parameters
    ----------
    centre, half : shape (n,)
        The box; ``half`` is 0 for frozen joints and for the spin joint.
    aim : shape (6,)
        Direction to try beside the centre's own residual: that of the smallest residual known,
        all zero where none is; for a spin joint its radial and axial parts.
    spare : shape (2, 6)
        Scratch.
    share : shape (n,), out
        What each joint costs the bound: the largest is the one to split.
    """
    n = centre.shape[0]
    mp = task.position_rows.shape[0]
    mo = task.orientation_rows.shape[0]
    norm = evaluate(chain, task, goal, centre, model)
    turned, u = spare[0], spare[1]
    radius = 0.0
    for a in range(3):
        turned[a] = goal[a]
    if spin >= 0:
        radius = _turn_goal(goal, spin, model, turned)
        if radius == 0.0:
            for i in range(n):
                share[i] = half[i] * model.distance[i]
            return 0.0, norm
    # Residual in world coordinates: rows that a planar arm cannot change are left out.
    total = 0.0
    for a in range(6):
        u[a] = 0.0
    for row in range(mp):
        value = 0.0
        for a in range(3):
            value += task.position_rows[row, a] * (model.tip[a] - turned[a])
        total += value * value
        for a in range(3):
            u[a] += value * task.position_rows[row, a]
    for row in range(mo):
        value = model.residual[mp + row]
        total += value * value
        for a in range(3):
            u[3 + a] += value * task.orientation_rows[row, a]
    norm = math.sqrt(total)
    length = task.length if mo > 0 else 0.0
    third = third_order_bound(chain, model.distance, length, half) / 6.0
    crude = _crude(chain, model.distance, length, half)
    best = norm - crude
    for a in range(6):
        turned[a] = u[a]  # now the residual itself
    for attempt in range(2):
        if attempt == 0:
            scale = 1.0 / norm if norm > 0.0 else 0.0
            for a in range(6):
                u[a] *= scale
        else:
            known = 0.0
            for a in range(6):
                known += aim[a] * aim[a]
            if known == 0.0:
                break
            for a in range(6):
                u[a] = aim[a]
            if spin >= 0:
                _unroll(aim, spin, model, radius, u)
        value = 0.0
        for a in range(6):
            value += u[a] * turned[a]
        for a in range(3):
            u[3 + a] *= length
        value -= _along(chain, task, u, half, model, share) + third
        if spin >= 0:
            value -= _circle_correction(chain, spin, half, model, u, radius, crude)
        best = max(best, value)
    total = 0.0
    for k in range(n):
        total += half[k] * (1.0 if chain.prismatic[k] else model.distance[k])
    for k in range(n):
        weight = 1.0 if chain.prismatic[k] else model.distance[k]
        share[k] += third * weight * half[k] / total if total > 0.0 else half[k]
    return best * (1.0 - 1e-9) - ABSOLUTE_ROUNDING * (1.0 + task.length), norm


@njit(cache=True, nogil=True)
def _unroll(aim: Array, spin: int, model: LocalModel, radius: float, u: Array) -> None:
    """World direction of ``aim``'s radial and axial parts about the spin axis."""
    along = 0.0
    for a in range(3):
        along += (model.tip[a] - model.origins[spin, a]) * model.axes[spin, a]
    for a in range(3):
        z = model.axes[spin, a]
        radial = (model.tip[a] - model.origins[spin, a] - along * z) / radius
        u[a] = aim[0] * radial + aim[1] * z


@njit(cache=True, nogil=True)
def aim_at(
    task: TaskArrays, goal: Array, spin: int, model: LocalModel, spare: Array, aim: Array
) -> None:
    """Direction of the evaluated posture's residual, for `lower_bound`; zero if there is none."""
    mp = task.position_rows.shape[0]
    turned = spare[0]
    for a in range(6):
        aim[a] = 0.0
    if spin >= 0:
        radius = _turn_goal(goal, spin, model, turned)
        if radius == 0.0:
            return
        along = 0.0
        for a in range(3):
            along += (model.tip[a] - model.origins[spin, a]) * model.axes[spin, a]
        for a in range(3):
            z = model.axes[spin, a]
            radial = (model.tip[a] - model.origins[spin, a] - along * z) / radius
            aim[0] += (model.tip[a] - turned[a]) * radial
            aim[1] += (model.tip[a] - turned[a]) * z
    else:
        for row in range(model.residual.shape[0]):
            for a in range(3):
                if row < mp:
                    aim[a] += model.residual[row] * task.position_rows[row, a]
                else:
                    aim[3 + a] += model.residual[row] * task.orientation_rows[row - mp, a]
    total = 0.0
    for a in range(6):
        total += aim[a] * aim[a]
    for a in range(6):
        aim[a] = aim[a] / math.sqrt(total) if total > 0.0 else 0.0


@njit(cache=True, nogil=True)
def _spread(
    chain: ChainArrays, spin: int, half: Array, model: LocalModel, radius: float, crude: float
) -> tuple[float, float]:
    """How near to the spin axis the tool comes over a box, and how far it goes round (m)."""
    zx, zy, zz = model.axes[spin, 0], model.axes[spin, 1], model.axes[spin, 2]
    tx = model.tip[0] - model.origins[spin, 0]
    ty = model.tip[1] - model.origins[spin, 1]
    tz = model.tip[2] - model.origins[spin, 2]
    along = tx * zx + ty * zy + tz * zz
    rx = (tx - along * zx) / radius
    ry = (ty - along * zy) / radius
    rz = (tz - along * zz) / radius
    sx, sy, sz = zy * rz - zz * ry, zz * rx - zx * rz, zx * ry - zy * rx
    radial = sideways = total = 0.0
    for k in range(half.shape[0]):
        if half[k] > 0.0:
            lx, ly, lz = model.linear[k, 0], model.linear[k, 1], model.linear[k, 2]
            radial += abs(rx * lx + ry * ly + rz * lz) * half[k]
            sideways += abs(sx * lx + sy * ly + sz * lz) * half[k]
            if not chain.prismatic[k]:
                total += half[k]
    remainder = crude * total  # bounds half the second derivative over the box
    nearest = radius - min(radial + remainder, crude)
    return nearest, min(sideways + remainder, crude)


@njit(cache=True, nogil=True)
def _circle_correction(
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
    axis than the goal an upper bound is needed: ``sqrt(a^2 + b^2) <= a + b^2 / (2 a)``.
    """
    along = outward = 0.0
    for a in range(3):
        along += (model.tip[a] - model.origins[spin, a]) * model.axes[spin, a]
    for a in range(3):
        across = model.tip[a] - model.origins[spin, a] - along * model.axes[spin, a]
        outward += u[a] * across / radius
    if outward >= 0.0:
        return 0.0
    nearest, sideways = _spread(chain, spin, half, model, radius, crude)
    if nearest <= 0.0:
        return math.inf
    return -outward * sideways * sideways / (2.0 * nearest)


@njit(cache=True, nogil=True)
def beyond_limits(
    chain: ChainArrays, goal: Array, spin: int, centre: Array, half: Array, model: LocalModel
) -> bool:
    """Whether nowhere in the box the spin joint can turn the tool to the goal's side.

    Then the nearest that it gets is at one of its limits, since the distance to the goal has a
    single minimum over a turn. Expects the model of `lower_bound` on the same box.
    """
    if chain.wraps[spin]:
        return False
    zx, zy, zz = model.axes[spin, 0], model.axes[spin, 1], model.axes[spin, 2]
    ox, oy, oz = model.origins[spin, 0], model.origins[spin, 1], model.origins[spin, 2]
    tx, ty, tz = model.tip[0] - ox, model.tip[1] - oy, model.tip[2] - oz
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
        chain, spin, half, model, radius, _crude(chain, model.distance, 0.0, half)
    )
    if nearest <= sideways:
        return False
    width = math.asin(sideways / nearest) + 1e-9
    # The window turned so that it starts at or after the lower limit.
    start = turn - width
    start -= 2.0 * math.pi * math.floor((start - chain.lower[spin]) / (2.0 * math.pi))
    return start > chain.upper[spin] and start + 2.0 * width < chain.lower[spin] + 2.0 * math.pi
