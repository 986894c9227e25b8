"""Compiled refutation: branch and bound over the free joints proves that no posture reaches.

On a box of postures around c, with u the unit residual at c::

    |F(c + d)| >= u . F(c + d) >= |r0| + sum_i g_i d_i + 1/2 sum_ik H_ik d_i d_k - T / 6

with the exact gradient g and Hessian H of ``u . F`` at c and a bound T of the third derivative
over the box. The first free joint, where it turns without limits, is minimised in closed form:
the goal becomes a circle about its axis and the box loses a dimension.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.ftws.certify import ABSOLUTE_ROUNDING, Scratch
from ft_manip_ros.core.ftws.local_model import LocalModel, evaluate, third_order_bound
from ft_manip_ros.core.ftws.posture import descend
from ft_manip_ros.core.ftws.task_map import TaskArrays

_STACK = 1024
# Share of the smallest residual found that the boxes have to prove: the ball of lost goals.
_PROVED_SHARE = 0.3


@njit(cache=True, nogil=True)
def spin_joint(chain: ChainArrays, task: TaskArrays, is_free: NDArray[np.bool_]) -> int:
    """First free joint if it turns without limits and only the position counts, else -1."""
    if task.orientation_rows.shape[0] > 0:
        return -1
    for i in range(is_free.shape[0]):
        if is_free[i]:
            return i if chain.wraps[i] else -1
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
def lower_bound(
    chain: ChainArrays,
    task: TaskArrays,
    goal: Array,
    turned: Array,
    spin: int,
    centre: Array,
    half: Array,
    model: LocalModel,
    share: Array,
) -> tuple[float, float]:
    """Proved lower bound of the residual over a box, and the residual at its centre (m).

    Parameters
    ----------
    centre, half : shape (n,)
        The box; ``half`` is 0 for frozen joints and for the spin joint.
    share : shape (n,), out
        What each joint costs the bound: the largest is the one to split.
    """
    n = centre.shape[0]
    norm = evaluate(chain, task, goal, centre, model)
    mp = task.position_rows.shape[0]
    mo = task.orientation_rows.shape[0]
    radius = 0.0
    if spin >= 0:
        radius = _turn_goal(goal, spin, model, turned)
        if radius > 0.0:
            total = 0.0
            for row in range(mp):
                value = 0.0
                for a in range(3):
                    value += task.position_rows[row, a] * (model.tip[a] - turned[a])
                model.residual[row] = value
                total += value * value
            norm = math.sqrt(total)
    inverse_norm = 1.0 / norm if norm > 0.0 else 0.0
    ux = uy = uz = 0.0
    for row in range(mp):
        value = model.residual[row] * inverse_norm
        ux += value * task.position_rows[row, 0]
        uy += value * task.position_rows[row, 1]
        uz += value * task.position_rows[row, 2]
    vx = vy = vz = 0.0
    length = task.length if mo > 0 else 0.0
    for row in range(mo):
        value = model.residual[mp + row] * inverse_norm * length
        vx += value * task.orientation_rows[row, 0]
        vy += value * task.orientation_rows[row, 1]
        vz += value * task.orientation_rows[row, 2]
    w, ex, ey, ez = model.error[0], model.error[1], model.error[2], model.error[3]
    along = ex * vx + ey * vy + ez * vz
    sx = 0.5 * (w * vx + ey * vz - ez * vy)
    sy = 0.5 * (w * vy + ez * vx - ex * vz)
    sz = 0.5 * (w * vz + ex * vy - ey * vx)
    bound = norm
    for i in range(n):
        share[i] = 0.0
    crude = 0.0
    for k in range(n):
        hk = half[k]
        if hk == 0.0:
            continue
        lx, ly, lz = model.linear[k, 0], model.linear[k, 1], model.linear[k, 2]
        kx, ky, kz = model.axes[k, 0], model.axes[k, 1], model.axes[k, 2]
        gradient = 0.0
        for row in range(mp + mo):
            gradient += model.residual[row] * model.jacobian[row, k]
        gradient = abs(gradient) * inverse_norm
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
                ) - 0.5 * (ax * kx + ay * ky + az * kz) * along
            if i < k:
                cost = abs(curvature) * half[i] * hk
                bound -= cost
                share[i] += 0.5 * cost
                share[k] += 0.5 * cost
            else:
                if curvature > 0.0 and gradient < curvature * hk:
                    cost = 0.5 * gradient * gradient / curvature
                else:
                    cost = gradient * hk - 0.5 * curvature * hk * hk
                bound -= cost
                share[k] += cost
        if chain.prismatic[k]:
            cost = gradient * hk
            bound -= cost
            share[k] += cost
    third = third_order_bound(chain, model.distance, length, half) / 6.0
    bound -= third
    total = 0.0
    moved = 0.0
    for k in range(n - 1, -1, -1):
        if half[k] > 0.0:
            if chain.prismatic[k]:
                step = half[k]
            else:
                step = (model.distance[k] + moved) * half[k]
            moved += half[k] if chain.prismatic[k] else step
            crude += math.sqrt(step * step + (length * half[k]) ** 2) if length > 0.0 else step
            total += step
    if total > 0.0:
        for k in range(n):
            if half[k] > 0.0:
                reach = 1.0 if chain.prismatic[k] else model.distance[k]
                share[k] += third * reach * half[k] / total
    if spin >= 0:
        if radius == 0.0:
            return 0.0, norm
        bound -= _circle_correction(spin, half, model, ux, uy, uz, radius, crude, chain)
    bound = max(bound, norm - crude)
    return bound * (1.0 - 1e-9) - ABSOLUTE_ROUNDING * (1.0 + task.length), norm


@njit(cache=True, nogil=True)
def _circle_correction(
    spin: int,
    half: Array,
    model: LocalModel,
    ux: float,
    uy: float,
    uz: float,
    radius: float,
    crude: float,
    chain: ChainArrays,
) -> float:
    """Give back what projecting the tool's radius onto its direction at the centre gains.

    The distance to the goal circle depends on the tool's radius about the axis, which is convex
    in the tool's position: the projection bounds it from below. Where the tool is nearer to the
    axis than the goal an upper bound is needed: ``sqrt(a^2 + b^2) <= a + b^2 / (2 a)``.
    """
    zx, zy, zz = model.axes[spin, 0], model.axes[spin, 1], model.axes[spin, 2]
    tx = model.tip[0] - model.origins[spin, 0]
    ty = model.tip[1] - model.origins[spin, 1]
    tz = model.tip[2] - model.origins[spin, 2]
    along = tx * zx + ty * zy + tz * zz
    rx, ry, rz = (
        (tx - along * zx) / radius,
        (ty - along * zy) / radius,
        (tz - along * zz) / radius,
    )
    outward = ux * rx + uy * ry + uz * rz
    if outward >= 0.0:
        return 0.0
    sx, sy, sz = zy * rz - zz * ry, zz * rx - zx * rz, zx * ry - zy * rx
    radial = 0.0
    sideways = 0.0
    for k in range(half.shape[0]):
        if half[k] > 0.0:
            lx, ly, lz = model.linear[k, 0], model.linear[k, 1], model.linear[k, 2]
            radial += abs(rx * lx + ry * ly + rz * lz) * half[k]
            sideways += abs(sx * lx + sy * ly + sz * lz) * half[k]
    # Second-order remainder of the tool's position along any direction.
    total = 0.0
    for k in range(half.shape[0]):
        if not chain.prismatic[k]:
            total += half[k]
    remainder = crude * total
    nearest = radius - min(radial + remainder, crude)
    if nearest <= 0.0:
        return math.inf
    sideways = min(sideways + remainder, crude)
    return -outward * sideways * sideways / (2.0 * nearest)


@njit(cache=True, nogil=True)
def refute(
    chain: ChainArrays,
    task: TaskArrays,
    goal: Array,
    q: Array,
    is_free: NDArray[np.bool_],
    frozen_half: Array,
    enough: float,
    best: float,
    tolerance: float,
    budget: int,
    stack: Array,
    s: Scratch,
) -> tuple[int, float, int]:
    """Prove that no posture of the free joints comes within ``enough`` of the goal.

    Parameters
    ----------
    q : shape (n,)
        Frozen joints at their positions; changed to the posture found, if one is.
    frozen_half : shape (n,)
        Half-widths around the frozen positions to refute at once (0: just these).
    enough : float
        Distance (m) that has to be exceeded: tolerance plus the ball of goals to refute.
    best : float
        Smallest residual known (m), e.g. of the search.
    stack : shape (2, S, n)
        Scratch for the boxes.

    Returns
    -------
    outcome : int
        1 refuted, -1 a posture within ``tolerance`` was found, 0 undecided.
    distance : float
        Proved lower bound of every posture's residual when refuted (m), else the best residual.
    boxes : int
        Boxes spent.
    """
    n = q.shape[0]
    if best <= enough:
        return (-1 if best <= tolerance else 0), best, 0
    spin = spin_joint(chain, task, is_free)
    for i in range(spin):
        if frozen_half[i] > 0.0:
            spin = -1  # its axis would move
            break
    turned = np.empty(3)
    share = np.empty(n)
    post = np.empty(n)
    centre, half = np.empty(n), np.empty(n)
    for i in range(n):
        if not is_free[i]:
            stack[0, 0, i] = q[i]
            stack[1, 0, i] = frozen_half[i]
        elif i == spin:
            stack[0, 0, i] = 0.0
            stack[1, 0, i] = 0.0
        else:
            stack[0, 0, i] = 0.5 * (chain.lower[i] + chain.upper[i])
            stack[1, 0, i] = 0.5 * (chain.upper[i] - chain.lower[i])
    top = 1
    boxes = 0
    proved = math.inf
    while top > 0:
        if boxes >= budget or top + 1 >= stack.shape[1]:
            return 0, best, boxes
        top -= 1
        boxes += 1
        for i in range(n):
            centre[i] = stack[0, top, i]
            half[i] = stack[1, top, i]
        target = enough + _PROVED_SHARE * (best - enough)
        bound, norm = lower_bound(
            chain, task, goal, turned, spin, centre, half, s.model, share
        )
        if bound > target:
            proved = min(proved, bound)
            continue
        if norm < 0.7 * best:
            for i in range(n):
                post[i] = centre[i]
            found = descend(
                chain, task, goal, post, is_free, s.model, s.weights, s.gram, s.trial,
                0.1 * tolerance,
            )  # fmt: skip
            if found < best:
                best = found
            if best <= tolerance:
                for i in range(n):
                    q[i] = post[i]
                return -1, best, boxes
            if best <= enough:
                return 0, best, boxes
        worst = 0
        for i in range(1, n):
            if share[i] * (half[i] > 0.0) > share[worst] * (half[worst] > 0.0):
                worst = i
        if half[worst] < 1e-9:
            return 0, best, boxes
        half[worst] *= 0.5
        for side in (-1.0, 1.0):
            for i in range(n):
                stack[0, top, i] = centre[i]
                stack[1, top, i] = half[i]
            stack[0, top, worst] += side * half[worst]
            top += 1
    return 1, proved, boxes
