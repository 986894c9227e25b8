"""Compiled higher derivatives of the task map: the exact third along a line, and bounds.

A derivative of the tool position is a nest of cross products (see `local_model`), so its norm is
at most the tool's distance to the axis of the last joint that takes part, and the sum over all
joint tuples of one order collapses to differences of powers of partial sums. A derivative of
order m of the error quaternion has norm ``2^-m``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.ftws.local_model import LocalModel
from ft_manip_ros.core.ftws.task_map import TaskArrays


@njit(cache=True, nogil=True)
def third_along(
    chain: ChainArrays, task: TaskArrays, model: LocalModel, d: Array, out: Array
) -> None:
    """Third derivative ``D3 F[d, d, d]`` at the evaluated posture, out (m,).

    With constant joint speeds d, what follows joint i moves as ``Rot(z_i, d_i t)`` times its own
    motion; the product rule carries the first three derivatives from the tool to the base.
    """
    axes, origins, tip, prismatic = model.axes, model.origins, model.tip, chain.prismatic
    position_rows, orientation_rows = task.position_rows, task.orientation_rows
    ax = ay = az = bx = by = bz = cx = cy = cz = 0.0
    for i in range(d.shape[0] - 1, -1, -1):
        wx, wy, wz = d[i] * axes[i, 0], d[i] * axes[i, 1], d[i] * axes[i, 2]
        if prismatic[i]:
            ax, ay, az = ax + wx, ay + wy, az + wz
            continue
        sx, sy, sz = tip[0] - origins[i, 0], tip[1] - origins[i, 1], tip[2] - origins[i, 2]
        x, y, z = wy * sz - wz * sy, wz * sx - wx * sz, wx * sy - wy * sx
        # third: w x (w x (w x s + 3 a) + 3 b) + c
        ux, uy, uz = x + 3.0 * ax, y + 3.0 * ay, z + 3.0 * az
        vx = wy * uz - wz * uy + 3.0 * bx
        vy = wz * ux - wx * uz + 3.0 * by
        vz = wx * uy - wy * ux + 3.0 * bz
        cx += wy * vz - wz * vy
        cy += wz * vx - wx * vz
        cz += wx * vy - wy * vx
        # second: w x (w x s + 2 a) + b
        ux, uy, uz = x + 2.0 * ax, y + 2.0 * ay, z + 2.0 * az
        bx += wy * uz - wz * uy
        by += wz * ux - wx * uz
        bz += wx * uy - wy * ux
        ax, ay, az = ax + x, ay + y, az + z
    mp = position_rows.shape[0]
    for row in range(mp):
        out[row] = (
            position_rows[row, 0] * cx + position_rows[row, 1] * cy + position_rows[row, 2] * cz
        )
    if orientation_rows.shape[0] > 0:
        x, y, z = _turn_third(prismatic, axes, model.error, d)
        for row in range(orientation_rows.shape[0]):
            out[mp + row] = (
                2.0
                * task.length
                * (
                    orientation_rows[row, 0] * x
                    + orientation_rows[row, 1] * y
                    + orientation_rows[row, 2] * z
                )
            )


@njit(cache=True, nogil=True)
def _turn_third(
    prismatic: NDArray[np.bool_], axes: Array, error: Array, d: Array
) -> tuple[float, float, float]:
    """Vector part of the error quaternion's third derivative at constant joint speeds."""
    aw = ax = ay = az = bw = bx = by = bz = cw = cx = cy = cz = 0.0
    for i in range(d.shape[0] - 1, -1, -1):
        if prismatic[i]:
            continue
        wx, wy, wz = 0.5 * d[i] * axes[i, 0], 0.5 * d[i] * axes[i, 1], 0.5 * d[i] * axes[i, 2]
        w, x, y, z = _half_turn(wx, wy, wz, error[0], error[1], error[2], error[3])
        uw, ux, uy, uz = _half_turn(
            wx, wy, wz, w + 3.0 * aw, x + 3.0 * ax, y + 3.0 * ay, z + 3.0 * az
        )
        uw, ux, uy, uz = _half_turn(
            wx, wy, wz, uw + 3.0 * bw, ux + 3.0 * bx, uy + 3.0 * by, uz + 3.0 * bz
        )
        cw, cx, cy, cz = cw + uw, cx + ux, cy + uy, cz + uz
        uw, ux, uy, uz = _half_turn(
            wx, wy, wz, w + 2.0 * aw, x + 2.0 * ax, y + 2.0 * ay, z + 2.0 * az
        )
        bw, bx, by, bz = bw + uw, bx + ux, by + uy, bz + uz
        aw, ax, ay, az = aw + w, ax + x, ay + y, az + z
    return cx, cy, cz


@njit(cache=True, nogil=True, inline='always')
def _half_turn(
    wx: float, wy: float, wz: float, qw: float, qx: float, qy: float, qz: float
) -> tuple[float, float, float, float]:
    """Product of the quaternions ``(0, w)`` and ``q``."""
    return (
        -wx * qx - wy * qy - wz * qz,
        wx * qw + wy * qz - wz * qy,
        wy * qw + wz * qx - wx * qz,
        wz * qw + wx * qy - wy * qx,
    )


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
    prismatic = chain.prismatic
    n = v.shape[0]
    total = 0.0
    for k in range(n):
        if not prismatic[k]:
            total += v[k]
    after = total
    moved = 0.0
    bound = 0.0
    for k in range(n - 1, -1, -1):
        if prismatic[k]:
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


@njit(cache=True, nogil=True)
def beyond_line(
    chain: ChainArrays, distance: Array, length: float, line: Array, v: Array
) -> float:
    """Bound of what the third and fourth order add to the third derivative along a line.

    Parameters
    ----------
    line : shape (n,)
        ``|a|``, the part of the displacement whose third derivative is known exactly.
    v : shape (n,)
        Half-widths of the box of displacements ``a + e``; ``v >= |a|``.

    Returns
    -------
    float
        Bound of ``|F(x + a + e) - (Taylor to second order) - D3 F[a, a, a] / 6|`` over the box:
        all third-order tuples that contain e, at the centre, and the fourth order over the box.
    """
    prismatic = chain.prismatic
    n = v.shape[0]
    total = line_total = 0.0
    for k in range(n):
        if not prismatic[k]:
            total += v[k]
            line_total += line[k]
    after, line_after = total, line_total
    moved = third = fourth = 0.0
    for k in range(n - 1, -1, -1):
        if prismatic[k]:
            square = after * after
            third += 3.0 * (v[k] * square - line[k] * line_after * line_after)
            fourth += 4.0 * v[k] * square * after
            moved += v[k]
        else:
            before = after - v[k]
            line_before = line_after - line[k]
            square, square_before = after * after, before * before
            cube = v[k] * (square + after * before + square_before)
            line_cube = line[k] * (
                line_after * line_after + line_after * line_before + line_before * line_before
            )
            third += distance[k] * (cube - line_cube)
            reach = distance[k] + moved
            fourth += reach * v[k] * (after + before) * (square + square_before)
            moved += v[k] * reach
            after, line_after = before, line_before
    if length > 0.0:
        square = total * total
        turned = 0.25 * length * (square * total - line_total * line_total * line_total)
        third = math.sqrt(third * third + turned * turned)
        turned = 0.125 * length * square * square
        fourth = math.sqrt(fourth * fourth + turned * turned)
    return third / 6.0 + fourth / 24.0
