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

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ftws.certify import ABSOLUTE_ROUNDING
from ft_manip_ros.core.ftws.local_model import LocalModel, evaluate
from ft_manip_ros.core.ftws.remainder import third_order_bound
from ft_manip_ros.core.ftws.spin import circle_correction, crude_bound, turn_goal, unroll
from ft_manip_ros.core.ftws.task_map import TaskArrays


@kernel
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
    linear, axes, error, prismatic = model.linear, model.axes, model.error, chain.prismatic
    n = half.shape[0]
    mo = task.orientation_rows.shape[0]
    ux, uy, uz = u[0], u[1], u[2]
    w, ex, ey, ez = error[0], error[1], error[2], error[3]
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
        lx, ly, lz = linear[k, 0], linear[k, 1], linear[k, 2]
        kx, ky, kz = axes[k, 0], axes[k, 1], axes[k, 2]
        gradient = ux * lx + uy * ly + uz * lz
        if mo > 0 and not prismatic[k]:
            gradient += 2.0 * (sx * kx + sy * ky + sz * kz)
        gradient = abs(gradient)
        for i in range(k + 1):
            if half[i] == 0.0 or prismatic[i]:
                continue
            ax, ay, az = axes[i, 0], axes[i, 1], axes[i, 2]
            curvature = (
                (uy * az - uz * ay) * lx + (uz * ax - ux * az) * ly + (ux * ay - uy * ax) * lz
            )
            if mo > 0 and not prismatic[k]:
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
        if prismatic[k]:
            share[k] += gradient * hk
            cost_total += gradient * hk
    return cost_total


@kernel
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
    target: float,
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
        What each joint costs the bound: the largest is the one to split. Unfinished where the
        bound is above the target.
    target : float
        A bound above this (m) is good enough.
    """
    n = centre.shape[0]
    position_rows, orientation_rows = task.position_rows, task.orientation_rows
    tip, distance, residual, prismatic = model.tip, model.distance, model.residual, chain.prismatic
    mp = position_rows.shape[0]
    mo = orientation_rows.shape[0]
    norm = evaluate(chain, task, goal, centre, model)
    turned, u = spare[0], spare[1]
    radius = 0.0
    for a in range(3):
        turned[a] = goal[a]
    if spin >= 0:
        radius = turn_goal(goal, spin, model, turned)
        if radius == 0.0:
            for i in range(n):
                share[i] = half[i] * distance[i]
            return 0.0, norm
    # Residual in world coordinates: rows that a planar arm cannot change are left out.
    total = 0.0
    for a in range(6):
        u[a] = 0.0
    for row in range(mp):
        value = 0.0
        for a in range(3):
            value += position_rows[row, a] * (tip[a] - turned[a])
        total += value * value
        for a in range(3):
            u[a] += value * position_rows[row, a]
    for row in range(mo):
        value = residual[mp + row]
        total += value * value
        for a in range(3):
            u[3 + a] += value * orientation_rows[row, a]
    norm = math.sqrt(total)
    length = task.length if mo > 0 else 0.0
    crude = crude_bound(chain, distance, length, half)
    rounding = ABSOLUTE_ROUNDING * (1.0 + task.length)
    enough = (target + rounding) * (1.0 + 2e-9)  # still above the target when rounded down
    best = norm - crude
    if best > enough:
        return best * (1.0 - 1e-9) - rounding, norm
    third = third_order_bound(chain, distance, length, half) / 6.0
    for a in range(6):
        turned[a] = u[a]  # now the residual itself
    bent = 0.0
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
                unroll(aim, spin, model, radius, u)
        value = 0.0
        for a in range(6):
            value += u[a] * turned[a]
        for a in range(3):
            u[3 + a] *= length
        value -= _along(chain, task, u, half, model, share) + third
        if spin >= 0:
            bent = circle_correction(chain, spin, half, model, u, radius, crude)
            value -= bent
        best = max(best, value)
        if best > enough:
            break
    total = 0.0
    for k in range(n):
        total += half[k] * (1.0 if prismatic[k] else distance[k])
    for k in range(n):
        weight = 1.0 if prismatic[k] else distance[k]
        share[k] += (third + bent) * weight * half[k] / total if total > 0.0 else half[k]
    return best * (1.0 - 1e-9) - rounding, norm


@kernel
def aim_at(
    task: TaskArrays, goal: Array, spin: int, model: LocalModel, spare: Array, aim: Array
) -> None:
    """Direction of the evaluated posture's residual, for `lower_bound`; zero if there is none."""
    position_rows, orientation_rows = task.position_rows, task.orientation_rows
    tip, axes, origins, residual = model.tip, model.axes, model.origins, model.residual
    mp = position_rows.shape[0]
    turned = spare[0]
    for a in range(6):
        aim[a] = 0.0
    if spin >= 0:
        radius = turn_goal(goal, spin, model, turned)
        if radius == 0.0:
            return
        along = 0.0
        for a in range(3):
            along += (tip[a] - origins[spin, a]) * axes[spin, a]
        for a in range(3):
            z = axes[spin, a]
            radial = (tip[a] - origins[spin, a] - along * z) / radius
            aim[0] += (tip[a] - turned[a]) * radial
            aim[1] += (tip[a] - turned[a]) * z
    else:
        for row in range(residual.shape[0]):
            for a in range(3):
                if row < mp:
                    aim[a] += residual[row] * position_rows[row, a]
                else:
                    aim[3 + a] += residual[row] * orientation_rows[row - mp, a]
    total = 0.0
    for a in range(6):
        total += aim[a] * aim[a]
    for a in range(6):
        aim[a] = aim[a] / math.sqrt(total) if total > 0.0 else 0.0
