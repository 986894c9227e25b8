"""Bernstein hulls of quintic segments: bounds on what a spline does between its points."""

from __future__ import annotations

import numpy as np
from numba import njit

from ft_manip_ros.core.chain import Array


def hull_positions(
    h: Array, q0: Array, v0: Array, a0: Array, q1: Array, v1: Array, a1: Array
) -> Array:
    """Bernstein coefficients, (S, 6, m), of the quintic of each of S segments of h seconds.

    Parameters
    ----------
    h : shape (S, 1)
        s.
    q0, v0, a0, q1, v1, a1 : shape (S, m)
        States at both ends.
    """
    return np.stack(
        [
            q0,
            q0 + v0 * h / 5.0,
            q0 + 2.0 * v0 * h / 5.0 + a0 * h**2 / 20.0,
            q1 - 2.0 * v1 * h / 5.0 + a1 * h**2 / 20.0,
            q1 - v1 * h / 5.0,
            q1,
        ],
        axis=1,
    )


def hull_velocities(
    h: Array, q0: Array, v0: Array, a0: Array, q1: Array, v1: Array, a1: Array
) -> Array:
    """Bernstein coefficients, (S, 5, m), of the speed within each segment."""
    middle = 5.0 * ((q1 - q0) / h - 0.4 * (v1 + v0) + 0.05 * (a1 - a0) * h)
    return np.stack([v0, v0 + a0 * h / 4.0, middle, v1 - a1 * h / 4.0, v1], axis=1)


def hull_accelerations(
    h: Array, q0: Array, v0: Array, a0: Array, q1: Array, v1: Array, a1: Array
) -> Array:
    """Bernstein coefficients, (S, 4, m), of the acceleration within each segment."""
    speeds = hull_velocities(h, q0, v0, a0, q1, v1, a1)
    inner = 4.0 * np.diff(speeds, axis=1)[:, 1:3] / h[:, None, :]
    return np.stack([a0, inner[:, 0], inner[:, 1], a1], axis=1)


@njit(cache=True, nogil=True)
def all_inside(
    times: Array,
    q: Array,
    v: Array,
    a: Array,
    positions: tuple[Array, Array],
    velocities: tuple[Array, Array],
    accelerations: tuple[Array, Array],
) -> bool:
    """Tell whether all hulls of a spline, (T,) and (T, m), lie in a range, (m,) at either end.

    The same as the hulls above say; False also where halved segments would have tighter ones.
    """
    for i in range(q.shape[1]):
        low, high = positions[0][i], positions[1][i]
        slow, fast = velocities[0][i], velocities[1][i]
        soft, hard = accelerations[0][i], accelerations[1][i]
        for k in range(times.shape[0]):
            # Written so that NaN is never inside.
            if not (low <= q[k, i] <= high and slow <= v[k, i] <= fast):
                return False
            if not soft <= a[k, i] <= hard:
                return False
        for k in range(times.shape[0] - 1):
            h = times[k + 1] - times[k]
            q0, v0, a0 = q[k, i], v[k, i], a[k, i]
            q1, v1, a1 = q[k + 1, i], v[k + 1, i], a[k + 1, i]
            for point in (
                q0 + v0 * h / 5.0,
                q0 + 2.0 * v0 * h / 5.0 + a0 * h**2 / 20.0,
                q1 - 2.0 * v1 * h / 5.0 + a1 * h**2 / 20.0,
                q1 - v1 * h / 5.0,
            ):
                if not low <= point <= high:
                    return False
            second, fourth = v0 + a0 * h / 4.0, v1 - a1 * h / 4.0
            middle = 5.0 * ((q1 - q0) / h - 0.4 * (v1 + v0) + 0.05 * (a1 - a0) * h)
            for point in (second, middle, fourth):
                if not slow <= point <= fast:
                    return False
            for point in (4.0 * (middle - second) / h, 4.0 * (fourth - middle) / h):
                if not soft <= point <= hard:
                    return False
    return True
