"""Compiled Taylor series of the tool's place along a curve of postures.

Whatever follows joint i turns with it: with t the tool's place about the joint before its turn,
seen from the base, the place after it is ``s_i = Rot(z_i, a_i) t_i``, and t_i is s_(i+1) but for
a constant. With the joint's change ``a_i`` a polynomial of the frozen position's change, the
coefficients of all s follow order by order, from the tool to the base.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ftws.local_model import LocalModel
from ft_manip_ros.core.ftws.turn_series import CURVE, TurnSeries, make_turn_series


class Series(NamedTuple):
    """Coefficients by power of the frozen position's change, of n joints.

    In ``crossed`` a row holds, each of them three numbers: ``z x (z x t)`` of order 0, then
    ``z x t`` and ``z x (z x t)`` of order 1, those of order 2, and ``z x t`` of order 3.
    """

    change: Array  # (n, CURVE+1), a_i
    first: Array  # (n, 3), first order of s_i
    second: Array  # (n, 3)
    third: Array  # (n, 3)
    crossed: Array  # (n, 18)
    total: Array  # (3,), the tool's own of the order in hand
    turn: TurnSeries


@njit(cache=True, nogil=True)
def make_series(n: int, oriented: bool) -> Series:
    """Allocate the series of n joints."""
    return Series(
        np.zeros((n, CURVE + 1)),
        np.zeros((n, 3)),
        np.zeros((n, 3)),
        np.zeros((n, 3)),
        np.zeros((n, 18)),
        np.zeros(3),
        make_turn_series(n if oriented else 0),
    )


@kernel
def cross(axes: Array, place: Array, crossed: Array, at: int) -> None:
    """``z_i x t_i`` and, but for the last order, ``z_i x (z_i x t_i)``, from s_(i+1)."""
    n = axes.shape[0]
    for i in range(n):
        u = v = w = 0.0
        ax, ay, az = axes[i, 0], axes[i, 1], axes[i, 2]
        if i + 1 < n:
            x, y, z = place[i + 1, 0], place[i + 1, 1], place[i + 1, 2]
            u, v, w = ay * z - az * y, az * x - ax * z, ax * y - ay * x
        crossed[i, at], crossed[i, at + 1], crossed[i, at + 2] = u, v, w
        if at < 15:
            crossed[i, at + 3] = ay * w - az * v
            crossed[i, at + 4] = az * u - ax * w
            crossed[i, at + 5] = ax * v - ay * u


@kernel
def add_change(linear: Array, change: Array, order: int, place: Array) -> None:
    """Let the joints' own coefficients of one order move what follows them."""
    x = y = z = 0.0
    for i in range(linear.shape[0] - 1, -1, -1):
        a = change[i, order]
        x, y, z = x + a * linear[i, 0], y + a * linear[i, 1], z + a * linear[i, 2]
        place[i, 0] += x
        place[i, 1] += y
        place[i, 2] += z


@kernel
def first_order(model: LocalModel, s: Series) -> None:
    """Order 1, and the cross products of order 0."""
    axes, linear, change, first, crossed = (
        model.axes, model.linear, s.change, s.first, s.crossed,
    )  # fmt: skip
    x = y = z = 0.0
    for i in range(linear.shape[0] - 1, -1, -1):
        a, u, v, w = change[i, 1], linear[i, 0], linear[i, 1], linear[i, 2]
        ax, ay, az = axes[i, 0], axes[i, 1], axes[i, 2]
        x, y, z = x + a * u, y + a * v, z + a * w
        first[i, 0], first[i, 1], first[i, 2] = x, y, z
        crossed[i, 0], crossed[i, 1], crossed[i, 2] = (
            ay * w - az * v,
            az * u - ax * w,
            ax * v - ay * u,
        )
    s.total[0], s.total[1], s.total[2] = 0.0, 0.0, 0.0
    cross(axes, first, crossed, 3)


@kernel
def second_order(prismatic: NDArray[np.bool_], s: Series) -> None:
    """Order 2, but for the joints' own: ``a_1 X_1 + a_1^2 / 2 W_0``."""
    change, second, c = s.change, s.second, s.crossed
    x = y = z = 0.0
    for i in range(second.shape[0] - 1, -1, -1):
        if not prismatic[i]:
            a = change[i, 1]
            b = 0.5 * a * a
            x += a * c[i, 3] + b * c[i, 0]
            y += a * c[i, 4] + b * c[i, 1]
            z += a * c[i, 5] + b * c[i, 2]
        second[i, 0], second[i, 1], second[i, 2] = x, y, z
    s.total[0], s.total[1], s.total[2] = x, y, z


@kernel
def third_order(prismatic: NDArray[np.bool_], linear: Array, s: Series) -> None:
    """Order 3, but for the joints' own, from the sine's and cosine's coefficients."""
    change, third, c = s.change, s.third, s.crossed
    x = y = z = 0.0
    for i in range(third.shape[0] - 1, -1, -1):
        if not prismatic[i]:
            a, b = change[i, 1], change[i, 2]
            cube, square, both = -a * a * a / 6.0, 0.5 * a * a, a * b
            x += (
                cube * linear[i, 0] + b * c[i, 3] + a * c[i, 9] + both * c[i, 0] + square * c[i, 6]
            )
            y += (
                cube * linear[i, 1]
                + b * c[i, 4]
                + a * c[i, 10]
                + both * c[i, 1]
                + square * c[i, 7]
            )
            z += (
                cube * linear[i, 2]
                + b * c[i, 5]
                + a * c[i, 11]
                + both * c[i, 2]
                + square * c[i, 8]
            )
        third[i, 0], third[i, 1], third[i, 2] = x, y, z
    s.total[0], s.total[1], s.total[2] = x, y, z


@kernel
def fourth_order(prismatic: NDArray[np.bool_], linear: Array, s: Series) -> None:
    """Order 4, but for the joints' own, of the tool itself."""
    change, c = s.change, s.crossed
    x = y = z = 0.0
    for i in range(linear.shape[0] - 1, -1, -1):
        if prismatic[i]:
            continue
        a1, a2, a3 = change[i, 1], change[i, 2], change[i, 3]
        square = a1 * a1
        s3, s4 = a3 - square * a1 / 6.0, -0.5 * square * a2
        v2, v3, v4 = 0.5 * square, a1 * a2, a1 * a3 + 0.5 * a2 * a2 - square * square / 24.0
        x += a1 * c[i, 15] + a2 * c[i, 9] + s3 * c[i, 3] + s4 * linear[i, 0]
        y += a1 * c[i, 16] + a2 * c[i, 10] + s3 * c[i, 4] + s4 * linear[i, 1]
        z += a1 * c[i, 17] + a2 * c[i, 11] + s3 * c[i, 5] + s4 * linear[i, 2]
        x += v2 * c[i, 12] + v3 * c[i, 6] + v4 * c[i, 0]
        y += v2 * c[i, 13] + v3 * c[i, 7] + v4 * c[i, 1]
        z += v2 * c[i, 14] + v3 * c[i, 8] + v4 * c[i, 2]
    s.total[0], s.total[1], s.total[2] = x, y, z
