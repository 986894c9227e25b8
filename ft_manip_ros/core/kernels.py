"""Compiled forward kinematics and Jacobians over `ChainArrays`, free of allocations."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ft_manip_ros.core.chain import Array, ChainArrays

# pi/2 in three parts of 33 bits and less: k times the first two is exact for |k| < 2^20, so the
# reduced argument keeps full relative precision (Cody & Waite; the parts and the polynomials on
# [-pi/4, pi/4] are those of fdlibm).
_HALF_PI_1 = 1.57079632673412561417e00
_HALF_PI_2 = 6.07710050630396597660e-11
_HALF_PI_3 = 2.02226624879595063154e-21
_REDUCIBLE = 1e6


@njit(cache=True, nogil=True, inline='always')
def sin_cos(x: float) -> tuple[float, float]:
    """Sine and cosine together, within 1 ulp of correct, at a third of the cost of two calls."""
    if not abs(x) < _REDUCIBLE:
        return math.sin(x), math.cos(x)
    k = math.floor(x * (2.0 / math.pi) + 0.5)
    r = ((x - k * _HALF_PI_1) - k * _HALF_PI_2) - k * _HALF_PI_3
    z = r * r
    s = r + r * z * (
        -1.66666666666666324348e-01
        + z
        * (
            8.33333333332248946124e-03
            + z
            * (
                -1.98412698298579493134e-04
                + z
                * (
                    2.75573137070700676789e-06
                    + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
                )
            )
        )
    )
    c = 1.0 - (
        0.5 * z
        - z
        * z
        * (
            4.16666666666666019037e-02
            + z
            * (
                -1.38888888888741095749e-03
                + z
                * (
                    2.48015872894767294178e-05
                    + z
                    * (
                        -2.75573143513906633035e-07
                        + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
                    )
                )
            )
        )
    )
    quadrant = int(k) & 3
    swap = (quadrant & 1) == 1
    sine = c if swap else s
    cosine = s if swap else c
    return sine * (1.0 - (quadrant & 2)), cosine * (1.0 - ((quadrant + 1) & 2))


@njit(cache=True, nogil=True)
def frames(
    chain: ChainArrays, q: Array, axes: Array, origins: Array, tip_rotation: Array, tip: Array
) -> None:
    """Joint axes, joint origins and tool frame in the base frame, written into the outputs.

    Parameters
    ----------
    chain
        The chain.
    q : shape (n,)
        Joint positions, rad or m.
    axes : shape (n, 3), out
        Unit axis of each joint.
    origins : shape (n, 3), out
        A point on each axis (before a prismatic joint's own motion), m.
    tip_rotation : shape (3, 3), out
    tip : shape (3,), out
        Tool rotation and position (m).
    """
    n = q.shape[0]
    rot = chain.rotations
    tra = chain.translations
    r00, r01, r02 = rot[0, 0, 0], rot[0, 0, 1], rot[0, 0, 2]
    r10, r11, r12 = rot[0, 1, 0], rot[0, 1, 1], rot[0, 1, 2]
    r20, r21, r22 = rot[0, 2, 0], rot[0, 2, 1], rot[0, 2, 2]
    x, y, z = tra[0, 0], tra[0, 1], tra[0, 2]
    for i in range(n):
        axes[i, 0] = r02
        axes[i, 1] = r12
        axes[i, 2] = r22
        origins[i, 0] = x
        origins[i, 1] = y
        origins[i, 2] = z
        if chain.prismatic[i]:
            x += r02 * q[i]
            y += r12 * q[i]
            z += r22 * q[i]
        else:
            s, c = sin_cos(q[i])
            r00, r01 = r00 * c + r01 * s, r01 * c - r00 * s
            r10, r11 = r10 * c + r11 * s, r11 * c - r10 * s
            r20, r21 = r20 * c + r21 * s, r21 * c - r20 * s
        tx, ty, tz = tra[i + 1, 0], tra[i + 1, 1], tra[i + 1, 2]
        x += r00 * tx + r01 * ty + r02 * tz
        y += r10 * tx + r11 * ty + r12 * tz
        z += r20 * tx + r21 * ty + r22 * tz
        p = rot[i + 1]
        a, b, d = r00, r01, r02
        r00 = a * p[0, 0] + b * p[1, 0] + d * p[2, 0]
        r01 = a * p[0, 1] + b * p[1, 1] + d * p[2, 1]
        r02 = a * p[0, 2] + b * p[1, 2] + d * p[2, 2]
        a, b, d = r10, r11, r12
        r10 = a * p[0, 0] + b * p[1, 0] + d * p[2, 0]
        r11 = a * p[0, 1] + b * p[1, 1] + d * p[2, 1]
        r12 = a * p[0, 2] + b * p[1, 2] + d * p[2, 2]
        a, b, d = r20, r21, r22
        r20 = a * p[0, 0] + b * p[1, 0] + d * p[2, 0]
        r21 = a * p[0, 1] + b * p[1, 1] + d * p[2, 1]
        r22 = a * p[0, 2] + b * p[1, 2] + d * p[2, 2]
    tip_rotation[0, 0], tip_rotation[0, 1], tip_rotation[0, 2] = r00, r01, r02
    tip_rotation[1, 0], tip_rotation[1, 1], tip_rotation[1, 2] = r10, r11, r12
    tip_rotation[2, 0], tip_rotation[2, 1], tip_rotation[2, 2] = r20, r21, r22
    tip[0], tip[1], tip[2] = x, y, z


@njit(cache=True, nogil=True)
def geometric_jacobian(
    chain: ChainArrays, axes: Array, origins: Array, tip: Array, jacobian: Array
) -> None:
    """Geometric Jacobian at the tool, base frame, from the outputs of `frames`.

    Parameters
    ----------
    jacobian : shape (6, n), out
        Rows 0-2: tool velocity per joint speed (m/rad, or 1 for a prismatic joint);
        rows 3-5: angular velocity per joint speed.
    """
    for i in range(axes.shape[0]):
        ax, ay, az = axes[i, 0], axes[i, 1], axes[i, 2]
        if chain.prismatic[i]:
            jacobian[0, i], jacobian[1, i], jacobian[2, i] = ax, ay, az
            jacobian[3, i], jacobian[4, i], jacobian[5, i] = 0.0, 0.0, 0.0
        else:
            dx = tip[0] - origins[i, 0]
            dy = tip[1] - origins[i, 1]
            dz = tip[2] - origins[i, 2]
            jacobian[0, i] = ay * dz - az * dy
            jacobian[1, i] = az * dx - ax * dz
            jacobian[2, i] = ax * dy - ay * dx
            jacobian[3, i], jacobian[4, i], jacobian[5, i] = ax, ay, az


@njit(cache=True, nogil=True)
def fk_batch(chain: ChainArrays, qs: Array, rotations: Array, positions: Array) -> None:
    """Tool frames of a batch of postures: qs (N, n) -> rotations (N, 3, 3), positions (N, 3)."""
    n = qs.shape[1]
    axes = np.empty((n, 3))
    origins = np.empty((n, 3))
    for k in range(qs.shape[0]):
        frames(chain, qs[k], axes, origins, rotations[k], positions[k])


@njit(cache=True, nogil=True)
def jacobian_batch(
    chain: ChainArrays, qs: Array, rotations: Array, positions: Array, jacobians: Array
) -> None:
    """Tool frames and Jacobians of a batch: jacobians (N, 6, n), base frame, at the tool."""
    n = qs.shape[1]
    axes = np.empty((n, 3))
    origins = np.empty((n, 3))
    for k in range(qs.shape[0]):
        frames(chain, qs[k], axes, origins, rotations[k], positions[k])
        geometric_jacobian(chain, axes, origins, positions[k], jacobians[k])
