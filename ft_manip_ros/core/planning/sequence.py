"""Choose one posture for each goal so that the whole way takes least time (Viterbi)."""

from __future__ import annotations

import math
from collections.abc import Sequence

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


@njit(cache=True, nogil=True)
def _cheapest_path(
    first: Array,
    postures: Array,
    extra: Array,
    sizes: NDArray[np.int64],
    added: Array,
    unlimited: NDArray[np.bool_],
    velocity: Array,
    acceleration: Array,
    jerk: Array,
) -> tuple[NDArray[np.int64], float]:
    layers, most = postures.shape[0], postures.shape[1]
    cost = np.full((layers, most), math.inf)
    came = np.zeros((layers, most), dtype=np.int64)
    for k in range(sizes[0]):
        cost[0, k] = first[k] + extra[0, k]
    for layer in range(1, layers):
        for k in range(sizes[layer]):
            for before in range(sizes[layer - 1]):
                if cost[layer - 1, before] >= cost[layer, k]:
                    continue
                total = cost[layer - 1, before] + added[layer, before, k]
                if total >= cost[layer, k]:
                    continue
                total += straight_time(
                    postures[layer - 1, before],
                    postures[layer, k],
                    unlimited,
                    velocity,
                    acceleration,
                    jerk,
                )
                if total < cost[layer, k]:
                    cost[layer, k] = total
                    came[layer, k] = before
            cost[layer, k] += extra[layer, k]
    path = np.zeros(layers, dtype=np.int64)
    path[-1] = np.argmin(cost[-1, : sizes[-1]])
    best = cost[-1, path[-1]]
    for layer in range(layers - 1, 0, -1):
        path[layer - 1] = came[layer, path[layer]]
    return path, best


def choose_postures(
    first: Array,
    candidates: list[Array],
    limits: MotionLimits,
    *,
    extra: list[Array] | None = None,
    penalties: Sequence[Array] | None = None,
) -> tuple[list[int], float]:
    """Pick one candidate of each goal for least total time, by dynamic programming.

    Parameters
    ----------
    first : shape (K_0,)
        Time (s) from the moving start state to each candidate of the first goal.
    candidates
        For each of the L goals in order, its postures, shape (K_l, m), K_l > 0.
    limits
        Rates of the m joints.
    extra
        Seconds to add for choosing a candidate, one array of shape (K_l,) a goal; how other
        wishes than time (distance from limits) weigh in.
    penalties
        Seconds to add for single moves, infinite where the way is blocked: for each goal but
        the first, shape (K_before, K_l).

    Returns
    -------
    indices
        L indices into ``candidates``.
    total
        Time (s) plus the chosen extras; infinite where every way is blocked.
    """
    layers, m = len(candidates), candidates[0].shape[1]
    sizes = np.array([len(c) for c in candidates], dtype=np.int64)
    postures = np.zeros((layers, int(sizes.max()), m))
    added = np.zeros(postures.shape[:2])
    for k, group in enumerate(candidates):
        postures[k, : len(group)] = group
        if extra is not None:
            added[k, : len(group)] = extra[k]
    between = np.zeros((layers, postures.shape[1], postures.shape[1]))
    for k, penalty in enumerate(penalties or (), start=1):
        between[k, : penalty.shape[0], : penalty.shape[1]] = penalty
    path, total = _cheapest_path(
        np.ascontiguousarray(first, dtype=float),
        postures,
        added,
        sizes,
        between,
        limits.unlimited,
        limits.velocity,
        limits.acceleration,
        limits.jerk,
    )
    return [int(k) for k in path], float(total)
