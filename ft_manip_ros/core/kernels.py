"""Compiled forward kinematics and Jacobians over `ChainArrays`, free of allocations."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel

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


@njit(cache=True, nogil=True, inline='always')
def sweep(
    rotations: Array,
    translations: Array,
    screws: Array,
    prismatic: NDArray[np.bool_],
    q: Array,
    axes: Array,
    origins: Array,
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Joint axes and origins as `frames` writes them, from the fields of `ChainArrays`.

    Returns the tool's position and, row by row, the rotation of the last joint's moved frame,
    to which the tool's own constant rotation still applies. Inlined, so that a caller who needs
    the position alone pays for nothing else; and given bare arrays, since every look-up of a
    tuple's field inside a loop costs two atomic reference counts.
    """
    r00, r01, r02 = rotations[0, 0, 0], rotations[0, 0, 1], rotations[0, 0, 2]
    r10, r11, r12 = rotations[0, 1, 0], rotations[0, 1, 1], rotations[0, 1, 2]
    r20, r21, r22 = rotations[0, 2, 0], rotations[0, 2, 1], rotations[0, 2, 2]
    x, y, z = translations[0, 0], translations[0, 1], translations[0, 2]
    for i in range(q.shape[0]):
        axes[i, 0], axes[i, 1], axes[i, 2] = r02, r12, r22
        origins[i, 0], origins[i, 1], origins[i, 2] = x, y, z
        angle = screws[i, 0]
        if prismatic[i]:
            x += r02 * q[i]
            y += r12 * q[i]
            z += r22 * q[i]
        else:
            angle += q[i]
        s, c = sin_cos(angle)
        r00, r01 = r00 * c + r01 * s, r01 * c - r00 * s
        r10, r11 = r10 * c + r11 * s, r11 * c - r10 * s
        r20, r21 = r20 * c + r21 * s, r21 * c - r20 * s
        tx, ty, tz = screws[i, 3], screws[i, 4], screws[i, 5]
        x += r00 * tx + r01 * ty + r02 * tz
        y += r10 * tx + r11 * ty + r12 * tz
        z += r20 * tx + r21 * ty + r22 * tz
        c, s = screws[i, 1], screws[i, 2]
        r01, r02 = r01 * c + r02 * s, r02 * c - r01 * s
        r11, r12 = r11 * c + r12 * s, r12 * c - r11 * s
        r21, r22 = r21 * c + r22 * s, r22 * c - r21 * s
    return (x, y, z), (r00, r01, r02, r10, r11, r12, r20, r21, r22)


@njit(cache=True, nogil=True, inline='always')
def turn_tool(rotations: Array, turned: tuple[float, ...], rotation: Array) -> None:
    """Write the tool's rotation (3, 3) from what `sweep` returned."""
    n = rotations.shape[0] - 1
    if n == 0:
        for j in range(9):
            rotation[j // 3, j % 3] = turned[j]
        return
    for j in range(3):
        a, b, c = rotations[n, 0, j], rotations[n, 1, j], rotations[n, 2, j]
        rotation[0, j] = turned[0] * a + turned[1] * b + turned[2] * c
        rotation[1, j] = turned[3] * a + turned[4] * b + turned[5] * c
        rotation[2, j] = turned[6] * a + turned[7] * b + turned[8] * c


@njit(cache=True, nogil=True, inline='always')
def drive(driver: NDArray[np.int64], ratio: Array, q: Array, out: Array) -> None:
    """Positions of the axes, (N,), of an arm with mimic joints, from those of its joints, (n,)."""
    for k in range(driver.shape[0]):
        out[k] = ratio[k] * q[driver[k]]


@kernel
def gather(driver: NDArray[np.int64], ratio: Array, columns: Array, out: Array) -> None:
    """Jacobian of the joints, one a row of ``out`` (n, m), from that of the axes, (N, m)."""
    out[:] = 0.0
    for k in range(driver.shape[0]):
        for a in range(out.shape[1]):
            out[driver[k], a] += ratio[k] * columns[k, a]


@njit(cache=True, nogil=True)
def frames(
    chain: ChainArrays, q: Array, axes: Array, origins: Array, tip_rotation: Array, tip: Array
) -> None:
    """Joint axes, joint origins and tool frame in the base frame, written into the outputs.

    Parameters
    ----------
    chain
        The chain.
    q : shape (N,)
        Positions of the axes, rad or m: those of the joints, unless one mimics another.
    axes : shape (N, 3), out
        Unit axis of each joint.
    origins : shape (N, 3), out
        A point on each axis (before a prismatic joint's own motion), m.
    tip_rotation : shape (3, 3), out
    tip : shape (3,), out
        Tool rotation and position (m).
    """
    place, turned = sweep(
        chain.rotations, chain.translations, chain.screws, chain.prismatic, q, axes, origins
    )
    tip[0], tip[1], tip[2] = place
    turn_tool(chain.rotations, turned, tip_rotation)


@njit(cache=True, nogil=True, inline='always')
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
    x, y, z = tip[0], tip[1], tip[2]
    for i in range(axes.shape[0]):
        ax, ay, az = axes[i, 0], axes[i, 1], axes[i, 2]
        if chain.prismatic[i]:
            jacobian[0, i], jacobian[1, i], jacobian[2, i] = ax, ay, az
            jacobian[3, i], jacobian[4, i], jacobian[5, i] = 0.0, 0.0, 0.0
        else:
            dx = x - origins[i, 0]
            dy = y - origins[i, 1]
            dz = z - origins[i, 2]
            jacobian[0, i] = ay * dz - az * dy
            jacobian[1, i] = az * dx - ax * dz
            jacobian[2, i] = ax * dy - ay * dx
            jacobian[3, i], jacobian[4, i], jacobian[5, i] = ax, ay, az


@njit(cache=True, nogil=True)
def fk_batch(chain: ChainArrays, qs: Array, rotations: Array, positions: Array) -> None:
    """Tool frames of a batch of postures: qs (N, n) -> rotations (N, 3, 3), positions (N, 3)."""
    placed, moved, screws = chain.rotations, chain.translations, chain.screws
    prismatic, driver, ratio = chain.prismatic, chain.driver, chain.ratio
    count = screws.shape[0]
    axes = np.empty((count, 3))
    origins = np.empty((count, 3))
    wide = np.empty(count)
    for k in range(qs.shape[0]):
        q = qs[k]
        if driver.shape[0] > 0:
            drive(driver, ratio, q, wide)
            q = wide
        place, turned = sweep(placed, moved, screws, prismatic, q, axes, origins)
        positions[k, 0], positions[k, 1], positions[k, 2] = place
        turn_tool(placed, turned, rotations[k])


@njit(cache=True, nogil=True)
def jacobian_batch(
    chain: ChainArrays, qs: Array, rotations: Array, positions: Array, jacobians: Array
) -> None:
    """Tool frames and Jacobians of a batch: jacobians (N, 6, n), base frame, at the tool."""
    placed, moved, screws = chain.rotations, chain.translations, chain.screws
    prismatic, driver, ratio = chain.prismatic, chain.driver, chain.ratio
    count = screws.shape[0]
    axes = np.empty((count, 3))
    origins = np.empty((count, 3))
    wide = np.empty(count)
    columns = np.empty((6, count))
    for k in range(qs.shape[0]):
        q = qs[k]
        if driver.shape[0] > 0:
            drive(driver, ratio, q, wide)
            q = wide
        place, turned = sweep(placed, moved, screws, prismatic, q, axes, origins)
        positions[k, 0], positions[k, 1], positions[k, 2] = place
        turn_tool(placed, turned, rotations[k])
        if driver.shape[0] > 0:
            geometric_jacobian(chain, axes, origins, positions[k], columns)
            gather(driver, ratio, columns.T, jacobians[k].T)
        else:
            geometric_jacobian(chain, axes, origins, positions[k], jacobians[k])
