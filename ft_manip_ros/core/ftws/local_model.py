"""Compiled local model of the task map: residual and Jacobian.

For a serial chain every derivative of the tool position is a nest of cross products: with
``i <= k``, ``d2p / dq_i dq_k = z_i x (dp / dq_k)`` where joint i is revolute and zero where it is
prismatic.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ftws.task_map import TaskArrays
from ft_manip_ros.core.kernels import sweep, turn_tool


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


@kernel
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


@kernel
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
    # Fields are read once: each look-up of a tuple's field in a loop costs two atomic counts.
    n = q.shape[0]
    axes, origins, linear = model.axes, model.origins, model.linear
    distance, residual, jacobian, tip = model.distance, model.residual, model.jacobian, model.tip
    prismatic, position_rows = chain.prismatic, task.position_rows
    place, turned = sweep(
        chain.rotations, chain.translations, chain.screws, prismatic, q, axes, origins
    )
    px, py, pz = place
    tip[0], tip[1], tip[2] = px, py, pz
    mp = position_rows.shape[0]
    spatial = mp == 3  # then the rows are the world's own
    for i in range(n):
        ax, ay, az = axes[i, 0], axes[i, 1], axes[i, 2]
        if prismatic[i]:
            x, y, z = ax, ay, az
        else:
            dx = px - origins[i, 0]
            dy = py - origins[i, 1]
            dz = pz - origins[i, 2]
            x = ay * dz - az * dy
            y = az * dx - ax * dz
            z = ax * dy - ay * dx
            distance[i] = math.sqrt(x * x + y * y + z * z)
        linear[i, 0], linear[i, 1], linear[i, 2] = x, y, z
        if spatial:
            jacobian[0, i], jacobian[1, i], jacobian[2, i] = x, y, z
    total = 0.0
    dx, dy, dz = px - goal[0], py - goal[1], pz - goal[2]
    if spatial:
        residual[0], residual[1], residual[2] = dx, dy, dz
        total = dx * dx + dy * dy + dz * dz
    else:
        for row in range(mp):
            a, b, c = position_rows[row, 0], position_rows[row, 1], position_rows[row, 2]
            value = a * dx + b * dy + c * dz
            residual[row] = value
            total += value * value
            for i in range(n):
                jacobian[row, i] = a * linear[i, 0] + b * linear[i, 1] + c * linear[i, 2]
    orientation_rows = task.orientation_rows
    mo = orientation_rows.shape[0]
    if mo > 0:
        error = model.error
        turn_tool(chain.rotations, turned, model.tip_rotation)
        _error_quaternion(model.tip_rotation, goal, error)
        w, ex, ey, ez = error[0], error[1], error[2], error[3]
        for row in range(mo):
            a = task.length * orientation_rows[row, 0]
            b = task.length * orientation_rows[row, 1]
            c = task.length * orientation_rows[row, 2]
            value = 2.0 * (a * ex + b * ey + c * ez)
            residual[mp + row] = value
            total += value * value
            for i in range(n):
                if prismatic[i]:
                    jacobian[mp + row, i] = 0.0
                else:
                    ax, ay, az = axes[i, 0], axes[i, 1], axes[i, 2]
                    gx = w * ax + ay * ez - az * ey
                    gy = w * ay + az * ex - ax * ez
                    gz = w * az + ax * ey - ay * ex
                    jacobian[mp + row, i] = a * gx + b * gy + c * gz
    return math.sqrt(total)
