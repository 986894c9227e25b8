"""Compiled local model of the task map: residual, Jacobian, exact Hessian, remainder bounds.

For a serial chain every derivative of the tool position is a nest of cross products: with
``i <= k``, ``d2p / dq_i dq_k = z_i x (dp / dq_k)`` where joint i is revolute and zero where it is
prismatic. So a derivative's norm is at most the tool's distance to the axis of the last joint
that takes part, and the sum over all joint tuples of one order collapses to differences of
powers of partial sums.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.ftws.task_map import TaskArrays
from ft_manip_ros.core.kernels import frames


class LocalModel(NamedTuple):
    """Scratch that `evaluate` fills; one per thread."""

    axes: Array  # (n, 3)
    origins: Array  # (n, 3)
    tip_rotation: Array  # (3, 3)
    tip: Array  # (3,)
    linear: Array  # (n, 3), dp / dq_i
    distance: Array  # (n,), of the tool to each revolute axis; unused for prismatic joints
    error: Array  # (4,), quaternion (w, x, y, z) of R R_goal^T with w >= 0
    residual: Array  # (m,)
    jacobian: Array  # (m, n)


@njit(cache=True, nogil=True)
def make_model(n: int, m: int) -> LocalModel:
    """Allocate the scratch for n joints and m equations."""
    return LocalModel(
        np.zeros((n, 3)),
        np.zeros((n, 3)),
        np.zeros((3, 3)),
        np.zeros(3),
        np.zeros((n, 3)),
        np.zeros(n),
        np.zeros(4),
        np.zeros(m),
        np.zeros((m, n)),
    )


@njit(cache=True, nogil=True)
def _error_quaternion(rotation: Array, goal: Array, out: Array) -> None:
    """Quaternion of ``rotation R_goal^T``; goal[3:7] is the goal's (w, x, y, z)."""
    r00, r11, r22 = rotation[0, 0], rotation[1, 1], rotation[2, 2]
    trace = r00 + r11 + r22
    if trace >= r00 and trace >= r11 and trace >= r22:
        w = 1.0 + trace
        x = rotation[2, 1] - rotation[1, 2]
        y = rotation[0, 2] - rotation[2, 0]
        z = rotation[1, 0] - rotation[0, 1]
    elif r00 >= r11 and r00 >= r22:
        w = rotation[2, 1] - rotation[1, 2]
        x = 1.0 + r00 - r11 - r22
        y = rotation[1, 0] + rotation[0, 1]
        z = rotation[2, 0] + rotation[0, 2]
    elif r11 >= r22:
        w = rotation[0, 2] - rotation[2, 0]
        x = rotation[1, 0] + rotation[0, 1]
        y = 1.0 + r11 - r00 - r22
        z = rotation[2, 1] + rotation[1, 2]
    else:
        w = rotation[1, 0] - rotation[0, 1]
        x = rotation[2, 0] + rotation[0, 2]
        y = rotation[2, 1] + rotation[1, 2]
        z = 1.0 + r22 - r00 - r11
    scale = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    a, b, c, d = goal[3], -goal[4], -goal[5], -goal[6]
    ew = (w * a - x * b - y * c - z * d) * scale
    if ew < 0.0:
        scale = -scale
    out[0] = abs(ew)
    out[1] = (w * b + x * a + y * d - z * c) * scale
    out[2] = (w * c - x * d + y * a + z * b) * scale
    out[3] = (w * d + x * c - y * b + z * a) * scale


@njit(cache=True, nogil=True)
def evaluate(
    chain: ChainArrays, task: TaskArrays, goal: Array, q: Array, model: LocalModel
) -> float:
    """Residual and Jacobian at posture ``q`` into ``model``; returns the residual's norm (m).

    Parameters
    ----------
    goal : shape (7,)
        Position (m) and quaternion (w, x, y, z); the latter is not read without orientation rows.
    q : shape (n,)
    """
    n = q.shape[0]
    frames(chain, q, model.axes, model.origins, model.tip_rotation, model.tip)
    tip, axes, origins, linear = model.tip, model.axes, model.origins, model.linear
    for i in range(n):
        ax, ay, az = axes[i, 0], axes[i, 1], axes[i, 2]
        if chain.prismatic[i]:
            linear[i, 0], linear[i, 1], linear[i, 2] = ax, ay, az
        else:
            dx = tip[0] - origins[i, 0]
            dy = tip[1] - origins[i, 1]
            dz = tip[2] - origins[i, 2]
            x = ay * dz - az * dy
            y = az * dx - ax * dz
            z = ax * dy - ay * dx
            linear[i, 0], linear[i, 1], linear[i, 2] = x, y, z
            model.distance[i] = math.sqrt(x * x + y * y + z * z)
    total = 0.0
    dx, dy, dz = tip[0] - goal[0], tip[1] - goal[1], tip[2] - goal[2]
    mp = task.position_rows.shape[0]
    for row in range(mp):
        a = task.position_rows[row, 0]
        b = task.position_rows[row, 1]
        c = task.position_rows[row, 2]
        value = a * dx + b * dy + c * dz
        model.residual[row] = value
        total += value * value
        for i in range(n):
            model.jacobian[row, i] = a * linear[i, 0] + b * linear[i, 1] + c * linear[i, 2]
    mo = task.orientation_rows.shape[0]
    if mo > 0:
        _error_quaternion(model.tip_rotation, goal, model.error)
        w, ex, ey, ez = model.error[0], model.error[1], model.error[2], model.error[3]
        for row in range(mo):
            a = task.length * task.orientation_rows[row, 0]
            b = task.length * task.orientation_rows[row, 1]
            c = task.length * task.orientation_rows[row, 2]
            value = 2.0 * (a * ex + b * ey + c * ez)
            model.residual[mp + row] = value
            total += value * value
            for i in range(n):
                if chain.prismatic[i]:
                    model.jacobian[mp + row, i] = 0.0
                else:
                    ax, ay, az = axes[i, 0], axes[i, 1], axes[i, 2]
                    gx = w * ax + ay * ez - az * ey
                    gy = w * ay + az * ex - ax * ez
                    gz = w * az + ax * ey - ay * ex
                    model.jacobian[mp + row, i] = a * gx + b * gy + c * gz
    return math.sqrt(total)


@njit(cache=True, nogil=True)
def hessian(chain: ChainArrays, task: TaskArrays, model: LocalModel, out: Array) -> None:
    """Second derivatives of the residual at the evaluated posture, out (m, n, n)."""
    n = model.axes.shape[0]
    mp = task.position_rows.shape[0]
    mo = task.orientation_rows.shape[0]
    w, ex, ey, ez = model.error[0], model.error[1], model.error[2], model.error[3]
    for k in range(n):
        lx, ly, lz = model.linear[k, 0], model.linear[k, 1], model.linear[k, 2]
        kx, ky, kz = model.axes[k, 0], model.axes[k, 1], model.axes[k, 2]
        for i in range(k + 1):
            if chain.prismatic[i]:
                for row in range(mp + mo):
                    out[row, i, k] = out[row, k, i] = 0.0
                continue
            ax, ay, az = model.axes[i, 0], model.axes[i, 1], model.axes[i, 2]
            px = ay * lz - az * ly
            py = az * lx - ax * lz
            pz = ax * ly - ay * lx
            for row in range(mp):
                value = (
                    task.position_rows[row, 0] * px
                    + task.position_rows[row, 1] * py
                    + task.position_rows[row, 2] * pz
                )
                out[row, i, k] = out[row, k, i] = value
            if mo == 0:
                continue
            hx = hy = hz = 0.0
            if not chain.prismatic[k]:
                # 2 vec(d2 q) = 1/2 vec(z_i z_k q), with q the error's quaternion
                dot = ax * kx + ay * ky + az * kz
                cx = ay * kz - az * ky
                cy = az * kx - ax * kz
                cz = ax * ky - ay * kx
                half = 0.5 * task.length
                hx = half * (w * cx + cy * ez - cz * ey - dot * ex)
                hy = half * (w * cy + cz * ex - cx * ez - dot * ey)
                hz = half * (w * cz + cx * ey - cy * ex - dot * ez)
            for row in range(mo):
                value = (
                    task.orientation_rows[row, 0] * hx
                    + task.orientation_rows[row, 1] * hy
                    + task.orientation_rows[row, 2] * hz
                )
                out[mp + row, i, k] = out[mp + row, k, i] = value


@njit(cache=True, nogil=True)
def third_order_bound(chain: ChainArrays, distance: Array, length: float, v: Array) -> float:
    """Bound of the third derivative along any direction within ``|dq_i| <= v_i``, over that box.

    Parameters
    ----------
    distance : shape (n,)
        Tool to axis at the box's centre (m); what the later joints can add is accounted for.
    length : float
        Metres per radian of the orientation rows, 0 without them.
    v : shape (n,)
        Half-widths of the box, >= 0.

    Returns
    -------
    float
        Bound of ``|D3 F[d, d, d]|`` for all d in the box, at every point of the box.
    """
    n = v.shape[0]
    total = 0.0
    for k in range(n):
        if not chain.prismatic[k]:
            total += v[k]
    after = total
    moved = 0.0
    bound = 0.0
    for k in range(n - 1, -1, -1):
        if chain.prismatic[k]:
            bound += 3.0 * v[k] * after * after
            moved += v[k]
        else:
            before = after - v[k]
            reach = distance[k] + moved
            bound += reach * v[k] * (after * after + after * before + before * before)
            moved += v[k] * reach
            after = before
    if length > 0.0:
        turning = 0.25 * length * total * total * total
        bound = math.sqrt(bound * bound + turning * turning)
    return bound
