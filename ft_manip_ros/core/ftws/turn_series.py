"""Compiled Taylor series of the error quaternion along a curve of postures."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ftws.local_model import LocalModel

# Orders of the curve, each cancelled by a direction of its own.
CURVE = 4


class TurnSeries(NamedTuple):
    """Coefficients by power of the frozen position's change: n joints, orders 0 to CURVE."""

    turn: Array  # (n, CURVE+1, 4), of the error quaternion, after the joint's turn
    turned: Array  # (n, CURVE+1, 4), (0, z_i) times the one before
    sine: Array  # (n, CURVE+1), of half the joint's change
    cosine: Array  # (n, CURVE+1)


@njit(cache=True, nogil=True)
def make_turn_series(n: int) -> TurnSeries:
    """Allocate the series of n joints."""
    orders = CURVE + 1
    return TurnSeries(
        np.zeros((n, orders, 4)),
        np.zeros((n, orders, 4)),
        np.zeros((n, orders)),
        np.zeros((n, orders)),
    )


@njit(cache=True, nogil=True, inline='always')
def half_turn(
    wx: float, wy: float, wz: float, qw: float, qx: float, qy: float, qz: float
) -> tuple[float, float, float, float]:
    """Product of the quaternions ``(0, w)`` and ``q``."""
    return (
        -wx * qx - wy * qy - wz * qz,
        wx * qw + wy * qz - wz * qy,
        wy * qw + wz * qx - wx * qz,
        wz * qw + wx * qy - wy * qx,
    )


@kernel
def _extend(change: Array, sine: Array, cosine: Array, i: int, order: int) -> None:
    """Next coefficient of the sine and cosine of ``a_i / 2``, from its lower ones alone."""
    along = across = 0.0
    for k in range(1, order):
        along += k * change[i, k] * cosine[i, order - k]
        across += k * change[i, k] * sine[i, order - k]
    sine[i, order] = 0.5 * along / order
    cosine[i, order] = -0.5 * across / order


@kernel
def carry_turn(
    chain: ChainArrays, model: LocalModel, change: Array, s: TurnSeries, order: int
) -> None:
    """Coefficients of one order from the tool to the base, but for ``a_i``'s own of that order.

    Parameters
    ----------
    change : shape (n, CURVE+1)
        The joints' changes ``a_i`` by power; those below ``order`` are read.
    """
    prismatic, error = chain.prismatic, model.error
    turn, turned, sine, cosine = s.turn, s.turned, s.sine, s.cosine
    n = prismatic.shape[0]
    w = x = y = z = 0.0
    for i in range(n - 1, -1, -1):
        if not prismatic[i]:
            _extend(change, sine, cosine, i, order)
            for k in range(1, order + 1):
                at = order - k
                a, b = sine[i, k], cosine[i, k]
                w += a * turned[i, at, 0]
                x += a * turned[i, at, 1]
                y += a * turned[i, at, 2]
                z += a * turned[i, at, 3]
                if at == 0:
                    w, x, y, z = (
                        w + b * error[0], x + b * error[1], y + b * error[2], z + b * error[3],
                    )  # fmt: skip
                elif i + 1 < n:
                    w += b * turn[i + 1, at, 0]
                    x += b * turn[i + 1, at, 1]
                    y += b * turn[i + 1, at, 2]
                    z += b * turn[i + 1, at, 3]
        turn[i, order, 0], turn[i, order, 1], turn[i, order, 2], turn[i, order, 3] = w, x, y, z


@kernel
def finish_turn(
    chain: ChainArrays, model: LocalModel, change: Array, s: TurnSeries, order: int
) -> None:
    """Add the joints' own coefficients of one order, after `carry_turn`; alone for order 0."""
    axes, prismatic, error = model.axes, chain.prismatic, model.error
    turn, turned, sine, cosine = s.turn, s.turned, s.sine, s.cosine
    n = prismatic.shape[0]
    w = x = y = z = 0.0
    for i in range(n - 1, -1, -1):
        if not prismatic[i]:
            qw = qx = qy = qz = 0.0
            if order == 0:
                qw, qx, qy, qz = error[0], error[1], error[2], error[3]
                sine[i, 0], cosine[i, 0] = 0.0, 1.0
            elif i + 1 < n:
                qw, qx, qy, qz = (
                    turn[i + 1, order, 0], turn[i + 1, order, 1], turn[i + 1, order, 2],
                    turn[i + 1, order, 3],
                )  # fmt: skip
            hw, hx, hy, hz = half_turn(axes[i, 0], axes[i, 1], axes[i, 2], qw, qx, qy, qz)
            turned[i, order, 0], turned[i, order, 1] = hw, hx
            turned[i, order, 2], turned[i, order, 3] = hy, hz
            if order > 0:
                a = 0.5 * change[i, order]
                sine[i, order] += a
                w += a * turned[i, 0, 0]
                x += a * turned[i, 0, 1]
                y += a * turned[i, 0, 2]
                z += a * turned[i, 0, 3]
        if order == 0:
            turn[i, 0, 0], turn[i, 0, 1], turn[i, 0, 2], turn[i, 0, 3] = (
                error[0], error[1], error[2], error[3],
            )  # fmt: skip
        else:
            turn[i, order, 0] += w
            turn[i, order, 1] += x
            turn[i, order, 2] += y
            turn[i, order, 3] += z
