"""How long straight joint-space moves take from rest to rest, in closed form."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.joint import FULL_TURN
from ft_manip_ros.core.planning.limits import MotionLimits


@njit(cache=True, nogil=True)
def rest_to_rest_time(way: float, velocity: float, acceleration: float, jerk: float) -> float:
    """Least time (s) of a jerk-limited move over ``way`` from rest to rest, in closed form.

    The double-S profile of Biagiotti & Melchiorri, Trajectory Planning for Automatic Machines
    and Robots (2008), section 3.4, with zero speed at both ends.
    """
    if way <= 0.0:
        return 0.0
    if velocity * jerk < acceleration * acceleration:
        ramp = 2.0 * math.sqrt(velocity / jerk)
    else:
        ramp = acceleration / jerk + velocity / acceleration
    if way >= velocity * ramp:
        return way / velocity + ramp
    if way >= 2.0 * acceleration**3 / jerk**2:
        half = 0.5 * acceleration / jerk
        return 2.0 * (half + math.sqrt(half * half + way / acceleration))
    return float(4.0 * (way / (2.0 * jerk)) ** (1.0 / 3.0))


@njit(cache=True, nogil=True)
def straight_time(
    a: Array,
    b: Array,
    unlimited: NDArray[np.bool_],
    velocity: Array,
    acceleration: Array,
    jerk: Array,
) -> float:
    """Least time (s) of the straight joint-space move between two rests, a and b of shape (m,)."""
    # The path parameter runs from 0 to 1; each joint bounds its rates by limit / way.
    v = a_max = j = math.inf
    for i in range(a.shape[0]):
        way = b[i] - a[i]
        if unlimited[i]:
            way -= round(way / FULL_TURN) * FULL_TURN
        way = abs(way)
        if way > 0.0:
            v = min(v, velocity[i] / way)
            a_max = min(a_max, acceleration[i] / way)
            j = min(j, jerk[i] / way)
    if v == math.inf:
        return 0.0
    return rest_to_rest_time(1.0, v, a_max, j)


def straight_times(a: Array, b: Array, limits: MotionLimits) -> Array:
    """Least times (s) of the moves from each of a, (K, m), to each of b, (M, m); shape (K, M)."""
    rates = (limits.unlimited, limits.velocity, limits.acceleration, limits.jerk)
    out = np.empty((len(a), len(b)))
    _straight_times(np.ascontiguousarray(a), np.ascontiguousarray(b), *rates, out)
    return out


@njit(cache=True, nogil=True)
def _straight_times(
    a: Array,
    b: Array,
    unlimited: NDArray[np.bool_],
    velocity: Array,
    acceleration: Array,
    jerk: Array,
    out: Array,
) -> None:
    for i in range(a.shape[0]):
        for k in range(b.shape[0]):
            out[i, k] = straight_time(a[i], b[k], unlimited, velocity, acceleration, jerk)
