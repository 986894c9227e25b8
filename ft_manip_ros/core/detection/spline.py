"""Motion between the points of a trajectory, as a joint_trajectory_controller interpolates."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_DEGREE = 5


@dataclass(frozen=True, eq=False)
class Spline:
    """Piecewise polynomials of some joints over time.

    Attributes
    ----------
    joints : ndarray of int, shape (m,)
        Places of the commanded joints in the arm.
    knots : ndarray, shape (p+1,)
        Times (s) at which the p pieces begin and the last one ends, strictly growing.
    coefficients : ndarray, shape (p, 6, m)
        Powers of (t - knot), lowest first.
    """

    joints: NDArray[np.int64]
    knots: Array
    coefficients: Array


@numba.njit(cache=True, nogil=True)
def evaluate(
    joints: NDArray[np.int64], knots: Array, coefficients: Array, t: float, out: Array
) -> None:
    """Write where a spline puts its joints at ``t`` (s) into those of the arm, ``out`` (n,)."""
    last = knots.shape[0] - 1
    if t <= knots[0]:
        piece, s = 0, 0.0
    elif t >= knots[last]:
        piece, s = last - 1, knots[last] - knots[last - 1]
    else:
        piece = int(np.searchsorted(knots, t, side='right')) - 1
        s = t - knots[piece]
    for i in range(joints.shape[0]):
        value = 0.0
        for power in range(_DEGREE, -1, -1):
            value = value * s + coefficients[piece, power, i]
        out[joints[i]] = value


@numba.njit(cache=True, nogil=True)
def evaluate_from(
    start: float,
    joints: NDArray[np.int64],
    knots: Array,
    coefficients: Array,
    times: Array,
    out: Array,
) -> None:
    """As `evaluate` at each of the ``times`` (K,) from ``start`` (s) on; ``out`` is (K, n)."""
    for k in range(times.shape[0]):
        if times[k] >= start:
            evaluate(joints, knots, coefficients, times[k], out[k])


def hermite(times: Array, positions: Array, velocities: Array, accelerations: Array) -> Array:
    """Coefficients, shape (p, 6, m), through the points, as the controller interpolates.

    Linear where velocities are NaN at either end of a piece, cubic with velocities, quintic with
    accelerations too.

    Parameters
    ----------
    times : ndarray, shape (p+1,)
    positions, velocities, accelerations : ndarray, shape (p+1, m)
        NaN marks derivatives that were not given.
    """
    h = np.diff(times)[:, None]
    p0, p1 = positions[:-1], positions[1:]
    v0, v1 = velocities[:-1], velocities[1:]
    a0, a1 = accelerations[:-1], accelerations[1:]
    out = np.zeros((len(h), _DEGREE + 1, positions.shape[1]))
    rise = p1 - p0
    linear = np.isnan(v0 + v1)
    quintic = ~linear & ~np.isnan(a0 + a1)
    out[:, 0] = p0
    out[:, 1] = np.where(linear, rise / h, v0)
    cubic_2 = (3 * rise / h - 2 * v0 - v1) / h
    cubic_3 = (v0 + v1 - 2 * rise / h) / h**2
    quintic_3 = (20 * rise - (8 * v1 + 12 * v0) * h - (3 * a0 - a1) * h**2) / (2 * h**3)
    quintic_4 = (-30 * rise + (14 * v1 + 16 * v0) * h + (3 * a0 - 2 * a1) * h**2) / (2 * h**4)
    quintic_5 = (12 * rise - 6 * (v1 + v0) * h + (a1 - a0) * h**2) / (2 * h**5)
    out[:, 2] = np.where(linear, 0.0, np.where(quintic, a0 / 2, cubic_2))
    out[:, 3] = np.where(linear, 0.0, np.where(quintic, quintic_3, cubic_3))
    out[:, 4] = np.where(quintic, quintic_4, 0.0)
    out[:, 5] = np.where(quintic, quintic_5, 0.0)
    return out
