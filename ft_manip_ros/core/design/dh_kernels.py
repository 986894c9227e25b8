"""Compiled geometry of an arm given as DH rows: tool residual, Jacobian and DH derivatives.

The design search changes the DH rows thousands of times a second, so its kernels read them
directly instead of rebuilding a `SerialChain` for each candidate.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

# How a goal is compared with the tool: position alone, all six coordinates, or position and the
# direction of the tool's z axis.
POSITION, POSE, AXIS = 0, 1, 2


class DhRows(NamedTuple):
    """A DH table of revolute joints, offsets zero, as the kernels read it."""

    d: Array  # (n,), m
    a: Array  # (n,), m
    cos_alpha: Array  # (n,)
    sin_alpha: Array  # (n,)


class Limits(NamedTuple):
    """Joint limits as the kernels read them."""

    lower: Array  # (n,), rad, physical limits
    upper: Array  # (n,)
    limited: BoolArray  # (n,), False for a full turn, which has no limit to violate
    freeze_lower: Array  # (n,), rad, operating limits: where a joint can freeze
    freeze_upper: Array  # (n,)


class Goals(NamedTuple):
    """Task goals as the kernels read them."""

    positions: Array  # (G, 3), m
    orientations: Array  # (G, 3, 3)
    modes: IntArray  # (G,), POSITION, POSE or AXIS


# Scratch memory of one solver: one array (planes, n + SPARE_ROWS, columns), so that the hot loops
# allocate nothing and the compiler has a single array to follow. Planes:
Z = 0  # (n, 3), joint axes
X = 1  # (n, 3), x axes after each joint's rotation
ORIGIN = 2  # (n+1, 3), frame origins, m; the last one is the tool
ROTATION = 3  # (3, 3), tool
COLUMN = 4  # (6, n), geometric Jacobian
COLUMN_BEFORE = 5  # (6, n)
HESSIAN = 6  # (f, f), over the f free joints
FACTOR = 7  # (f, f)
MATRIX = 8  # (f, f), quasi-Newton matrix
MEMORY = 9  # rows for the quasi-Newton update
VECTORS = 10  # the rows below
_PLANES = 11
# Rows of VECTORS:
ERROR = 0  # (6,), position error (m) above rotation error (rad)
VIOLATION = 1  # (n,), rad, signed distance past the nearest limit
GRADIENT = 2  # (f,)
STEP = 3  # (f,)
TRIAL = 4  # (n,)
SPARE_ROWS = 8

Work = NDArray[np.float64]


def make_rows(d: Array, a: Array, alpha: Array) -> DhRows:
    """Return the rows of a table, cosines and sines taken once."""
    return DhRows(
        np.ascontiguousarray(d, dtype=float),
        np.ascontiguousarray(a, dtype=float),
        np.cos(alpha),
        np.sin(alpha),
    )


def make_work(n: int) -> Work:
    """Return scratch memory for an arm of ``n`` joints."""
    return np.zeros((_PLANES, n + SPARE_ROWS, max(n, SPARE_ROWS)))


@njit(cache=True, nogil=True, error_model='numpy')
def frames(rows: DhRows, q: Array, work: Work) -> None:
    """Forward kinematics of T_i = Rz(q_i) Tz(d_i) Tx(a_i) Rx(alpha_i), written into ``work``."""
    r00, r01, r02 = 1.0, 0.0, 0.0
    r10, r11, r12 = 0.0, 1.0, 0.0
    r20, r21, r22 = 0.0, 0.0, 1.0
    px, py, pz = 0.0, 0.0, 0.0
    n = rows.a.shape[0]
    for i in range(n):
        work[ORIGIN, i, 0], work[ORIGIN, i, 1], work[ORIGIN, i, 2] = px, py, pz
        work[Z, i, 0], work[Z, i, 1], work[Z, i, 2] = r02, r12, r22
        c, s = math.cos(q[i]), math.sin(q[i])
        r00, r01 = r00 * c + r01 * s, r01 * c - r00 * s
        r10, r11 = r10 * c + r11 * s, r11 * c - r10 * s
        r20, r21 = r20 * c + r21 * s, r21 * c - r20 * s
        work[X, i, 0], work[X, i, 1], work[X, i, 2] = r00, r10, r20
        a, d = rows.a[i], rows.d[i]
        px += a * r00 + d * r02
        py += a * r10 + d * r12
        pz += a * r20 + d * r22
        c, s = rows.cos_alpha[i], rows.sin_alpha[i]
        r01, r02 = r01 * c + r02 * s, r02 * c - r01 * s
        r11, r12 = r11 * c + r12 * s, r12 * c - r11 * s
        r21, r22 = r21 * c + r22 * s, r22 * c - r21 * s
    work[ORIGIN, n, 0], work[ORIGIN, n, 1], work[ORIGIN, n, 2] = px, py, pz
    work[ROTATION, 0, 0], work[ROTATION, 0, 1], work[ROTATION, 0, 2] = r00, r01, r02
    work[ROTATION, 1, 0], work[ROTATION, 1, 1], work[ROTATION, 1, 2] = r10, r11, r12
    work[ROTATION, 2, 0], work[ROTATION, 2, 1], work[ROTATION, 2, 2] = r20, r21, r22


@njit(cache=True, nogil=True, error_model='numpy')
def tool_error(goals: Goals, goal: int, work: Work) -> float:
    """Fill the row ERROR from the frames in ``work``; return its squared norm.

    The position error is p - p_goal; the rotation error is the rotation vector (base frame) that
    leads from the goal's orientation (or z axis) to the tool's.
    """
    n = work.shape[1] - SPARE_ROWS
    total = 0.0
    for k in range(3):
        work[VECTORS, ERROR, k] = work[ORIGIN, n, k] - goals.positions[goal, k]
        work[VECTORS, ERROR, 3 + k] = 0.0
        total += work[VECTORS, ERROR, k] ** 2
    mode = goals.modes[goal]
    if mode == POSITION:
        return total
    r, g = work[ROTATION], goals.orientations[goal]
    if mode == POSE:
        # e = R R_goal^T, its antisymmetric part and trace
        trace = 0.0
        for k in range(3):
            trace += r[k, 0] * g[k, 0] + r[k, 1] * g[k, 1] + r[k, 2] * g[k, 2]
        e21 = r[2, 0] * g[1, 0] + r[2, 1] * g[1, 1] + r[2, 2] * g[1, 2]
        e12 = r[1, 0] * g[2, 0] + r[1, 1] * g[2, 1] + r[1, 2] * g[2, 2]
        e02 = r[0, 0] * g[2, 0] + r[0, 1] * g[2, 1] + r[0, 2] * g[2, 2]
        e20 = r[2, 0] * g[0, 0] + r[2, 1] * g[0, 1] + r[2, 2] * g[0, 2]
        e10 = r[1, 0] * g[0, 0] + r[1, 1] * g[0, 1] + r[1, 2] * g[0, 2]
        e01 = r[0, 0] * g[1, 0] + r[0, 1] * g[1, 1] + r[0, 2] * g[1, 2]
        vx, vy, vz = 0.5 * (e21 - e12), 0.5 * (e02 - e20), 0.5 * (e10 - e01)
        cosine = 0.5 * (trace - 1.0)
    else:
        vx = g[1, 2] * r[2, 2] - g[2, 2] * r[1, 2]
        vy = g[2, 2] * r[0, 2] - g[0, 2] * r[2, 2]
        vz = g[0, 2] * r[1, 2] - g[1, 2] * r[0, 2]
        cosine = g[0, 2] * r[0, 2] + g[1, 2] * r[1, 2] + g[2, 2] * r[2, 2]
    sine = math.sqrt(vx * vx + vy * vy + vz * vz)
    angle = math.atan2(sine, cosine)
    if sine > 1e-9:
        scale = angle / sine
        vx, vy, vz = vx * scale, vy * scale, vz * scale
    elif cosine < 0.0:
        # Half a turn: the axis is lost; any axis is an honest size and leads away from here.
        vx, vy, vz = math.pi, 0.0, 0.0
    work[VECTORS, ERROR, 3], work[VECTORS, ERROR, 4], work[VECTORS, ERROR, 5] = vx, vy, vz
    return total + vx * vx + vy * vy + vz * vz


@njit(cache=True, nogil=True, error_model='numpy')
def jacobian_columns(mode: int, work: Work) -> None:
    """Fill the plane COLUMN from the frames: linear rows above angular rows."""
    n = work.shape[1] - SPARE_ROWS
    for i in range(n):
        zx, zy, zz = work[Z, i, 0], work[Z, i, 1], work[Z, i, 2]
        dx = work[ORIGIN, n, 0] - work[ORIGIN, i, 0]
        dy = work[ORIGIN, n, 1] - work[ORIGIN, i, 1]
        dz = work[ORIGIN, n, 2] - work[ORIGIN, i, 2]
        work[COLUMN, 0, i] = zy * dz - zz * dy
        work[COLUMN, 1, i] = zz * dx - zx * dz
        work[COLUMN, 2, i] = zx * dy - zy * dx
        if mode == POSITION:
            work[COLUMN, 3, i], work[COLUMN, 4, i], work[COLUMN, 5, i] = 0.0, 0.0, 0.0
        else:
            if mode == AXIS:
                # Spinning about the tool's own axis changes nothing that the goal asks for.
                tx, ty, tz = work[ROTATION, 0, 2], work[ROTATION, 1, 2], work[ROTATION, 2, 2]
                along = zx * tx + zy * ty + zz * tz
                zx, zy, zz = zx - along * tx, zy - along * ty, zz - along * tz
            work[COLUMN, 3, i], work[COLUMN, 4, i], work[COLUMN, 5, i] = zx, zy, zz


@njit(cache=True, nogil=True, error_model='numpy')
def dh_gradient(mode: int, work: Work, out: Array) -> None:
    """Gradient of half the squared tool error over the 3n DH parameters (d, a, alpha).

    At a posture that minimises the penalty this is also the gradient of the minimum itself
    (envelope theorem), which is what makes descent over the DH parameters cheap.
    """
    n = work.shape[1] - SPARE_ROWS
    e = work[VECTORS, ERROR]
    for i in range(n):
        x0, x1, x2 = work[X, i, 0], work[X, i, 1], work[X, i, 2]
        out[i] = e[0] * work[Z, i, 0] + e[1] * work[Z, i, 1] + e[2] * work[Z, i, 2]
        out[n + i] = e[0] * x0 + e[1] * x1 + e[2] * x2
        dx = work[ORIGIN, n, 0] - work[ORIGIN, i + 1, 0]
        dy = work[ORIGIN, n, 1] - work[ORIGIN, i + 1, 1]
        dz = work[ORIGIN, n, 2] - work[ORIGIN, i + 1, 2]
        out[2 * n + i] = (
            e[0] * (x1 * dz - x2 * dy) + e[1] * (x2 * dx - x0 * dz) + e[2] * (x0 * dy - x1 * dx)
        )
        if mode != POSITION:
            out[2 * n + i] += e[3] * x0 + e[4] * x1 + e[5] * x2
