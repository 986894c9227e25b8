"""Compiled second derivatives along directions, and the Jacobian's series along a curve."""

from __future__ import annotations

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ftws.local_model import LocalModel
from ft_manip_ros.core.ftws.place_series import Series
from ft_manip_ros.core.ftws.task_map import TaskArrays
from ft_manip_ros.core.ftws.turn_series import half_turn


@kernel
def bend(chain: ChainArrays, task: TaskArrays, model: LocalModel, d: Array, out: Array) -> None:
    """Second derivative times one direction, ``D2 F[d, .]``, out (m, n).

    With ``i <= k``, ``d2p / dq_i dq_k = z_i x dp/dq_k``, and of the error quaternion
    ``z_i z_k q / 4``: column k needs only the sums of what turns before and after it.
    """
    axes, linear, prismatic, error = model.axes, model.linear, chain.prismatic, model.error
    position_rows, orientation_rows = task.position_rows, task.orientation_rows
    n = d.shape[0]
    mp = position_rows.shape[0]
    wx = wy = wz = 0.0  # turning of the joints up to k
    vx = vy = vz = 0.0  # tool's velocity by the joints after k
    tx = ty = tz = 0.0  # their turning
    for i in range(n):
        vx, vy, vz = vx + d[i] * linear[i, 0], vy + d[i] * linear[i, 1], vz + d[i] * linear[i, 2]
        if not prismatic[i]:
            tx, ty, tz = tx + d[i] * axes[i, 0], ty + d[i] * axes[i, 1], tz + d[i] * axes[i, 2]
    for k in range(n):
        ax, ay, az = axes[k, 0], axes[k, 1], axes[k, 2]
        lx, ly, lz = linear[k, 0], linear[k, 1], linear[k, 2]
        vx, vy, vz = vx - d[k] * lx, vy - d[k] * ly, vz - d[k] * lz
        if not prismatic[k]:
            wx, wy, wz = wx + d[k] * ax, wy + d[k] * ay, wz + d[k] * az
            tx, ty, tz = tx - d[k] * ax, ty - d[k] * ay, tz - d[k] * az
        x, y, z = wy * lz - wz * ly, wz * lx - wx * lz, wx * ly - wy * lx
        if not prismatic[k]:
            x, y, z = x + ay * vz - az * vy, y + az * vx - ax * vz, z + ax * vy - ay * vx
        for row in range(mp):
            out[row, k] = (
                position_rows[row, 0] * x + position_rows[row, 1] * y + position_rows[row, 2] * z
            )
        if orientation_rows.shape[0] > 0:
            x = y = z = 0.0
            if not prismatic[k]:
                w, x, y, z = half_turn(ax, ay, az, error[0], error[1], error[2], error[3])
                _, x, y, z = half_turn(wx, wy, wz, w, x, y, z)
                w, u, v, q = half_turn(tx, ty, tz, error[0], error[1], error[2], error[3])
                _, u, v, q = half_turn(ax, ay, az, w, u, v, q)
                x, y, z = x + u, y + v, z + q
            half = 0.5 * task.length
            for row in range(orientation_rows.shape[0]):
                out[mp + row, k] = half * (
                    orientation_rows[row, 0] * x
                    + orientation_rows[row, 1] * y
                    + orientation_rows[row, 2] * z
                )


@kernel
def second_slope(
    chain: ChainArrays, task: TaskArrays, model: LocalModel, s: Series, out: Array
) -> None:
    """Second-order coefficient of the Jacobian's position rows along the curve, out (m, n).

    Column j is ``z_j x s_j``, turned by the joints before it; orientation rows are left alone.
    """
    axes, prismatic, change = model.axes, chain.prismatic, s.change
    first, second = s.first, s.second
    linear, position_rows = model.linear, task.position_rows
    n = axes.shape[0]
    mp = position_rows.shape[0]
    # Turns of the joints so far: first order (a vector), second order (a matrix).
    wx = wy = wz = 0.0
    m00 = m01 = m02 = m10 = m11 = m12 = m20 = m21 = m22 = 0.0
    for j in range(n):
        ax, ay, az = axes[j, 0], axes[j, 1], axes[j, 2]
        lx, ly, lz = linear[j, 0], linear[j, 1], linear[j, 2]
        x = m00 * lx + m01 * ly + m02 * lz
        y = m10 * lx + m11 * ly + m12 * lz
        z = m20 * lx + m21 * ly + m22 * lz
        if not prismatic[j]:
            px, py, pz = first[j, 0], first[j, 1], first[j, 2]
            ux, uy, uz = ay * pz - az * py, az * px - ax * pz, ax * py - ay * px
            px, py, pz = second[j, 0], second[j, 1], second[j, 2]
            x += wy * uz - wz * uy + ay * pz - az * py
            y += wz * ux - wx * uz + az * px - ax * pz
            z += wx * uy - wy * ux + ax * py - ay * px
        for row in range(mp):
            out[row, j] = (
                position_rows[row, 0] * x + position_rows[row, 1] * y + position_rows[row, 2] * z
            )
        if prismatic[j]:
            continue
        a, b = change[j, 1], change[j, 2]
        # [w]x [z]x = z w^T - (w . z) I
        along = a * (wx * ax + wy * ay + wz * az)
        half = 0.5 * a * a
        ux, uy, uz = a * wx + half * ax, a * wy + half * ay, a * wz + half * az
        along += half
        m00, m01, m02 = m00 + ax * ux - along, m01 + ax * uy - b * az, m02 + ax * uz + b * ay
        m10, m11, m12 = m10 + ay * ux + b * az, m11 + ay * uy - along, m12 + ay * uz - b * ax
        m20, m21, m22 = m20 + az * ux - b * ay, m21 + az * uy + b * ax, m22 + az * uz - along
        wx, wy, wz = wx + a * ax, wy + a * ay, wz + a * az
