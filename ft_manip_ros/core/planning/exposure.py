"""How long the moves of a path expose the rest of its task to a lock, and how to do so less."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.joint import FULL_TURN
from ft_manip_ros.core.planning.limits import MotionLimits, travel
from ft_manip_ros.core.planning.move_times import straight_times

# Instants of each move that are looked at.
_INSTANTS = 25
# Seconds of exposure that one second of motion is worth: decides between equals only.
_TIME_WEIGHT = 1e-3
# Joints up to which all orders of moving some before the others are tried.
_MOST_ORDERED = 8


@dataclass(frozen=True, eq=False)
class Exposure:
    """What a lock costs while the same goals remain.

    Attributes
    ----------
    angles : ndarray, shape (n, A)
        Positions of each joint at which a lock was tried, evenly spread over its range.
    survived : ndarray of bool, shape (n, A)
        Whether every goal that remains is then known to be within reach.
    limits
        Of the moves.
    """

    angles: Array
    survived: NDArray[np.bool_]
    limits: MotionLimits

    def at_rest(self, postures: Array) -> NDArray[np.int64]:
        """Joints that must not lock at some postures, (K, n); shape (K,)."""
        return np.sum(~self._may_lock(postures), axis=-1)

    def moves(self, a: Array, b: Array) -> Array:
        """Exposure (s) of the straight moves from rest at each of a, (K, n), to each of b, (M, n).

        Summed over the joints, with a little for the time it takes; shape (K, M).
        """
        tau = np.linspace(0.0, 1.0, _INSTANTS)
        # The rest-to-rest profile, near enough for weighing one move against another.
        s = tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2)
        costs = np.empty((len(a), len(b)))
        for k in range(len(a)):
            q = a[k] + s[:, None, None] * travel(a[k], b, self.limits.unlimited)
            costs[k] = self.at_rest(q).mean(axis=0) + _TIME_WEIGHT
        return costs * straight_times(a, b, self.limits)

    def least(self, postures: Array, count: int) -> Array:
        """Those of some postures, (K, n), at which the fewest joints must not lock."""
        order = np.argsort(self.at_rest(postures), kind='stable')
        return postures[order[:count]]

    def best_way(self, a: Array, b: Array, others: Array) -> list[Array]:
        """Postures to go by from a to b, (n,): none, one of some, or some joints move first."""
        target = a + travel(a, b, self.limits.unlimited)
        n = len(a)
        orders = []
        if n <= _MOST_ORDERED:
            for size in range(1, n):
                for first in combinations(range(n), size):
                    corner = a.copy()
                    corner[list(first)] = target[list(first)]
                    orders.append(corner)
        vias = np.concatenate([others, np.array(orders).reshape(-1, n)])
        costs = self.moves(a[None, :], vias)[0] + self.moves(vias, b[None, :])[:, 0]
        best = int(np.argmin(costs))
        return [vias[best]] if costs[best] < self.moves(a[None, :], b[None, :])[0, 0] else []

    def _may_lock(self, q: Array) -> NDArray[np.bool_]:
        """Tell for joint positions, (..., n), whether both grid neighbours survive a lock."""
        lower, upper = self.angles[:, 0], self.angles[:, -1]
        # A joint that turns on and on passes the same places again.
        q = np.where(self.limits.turns, lower + np.mod(q - lower, FULL_TURN), q)
        last = self.angles.shape[1] - 1
        place = (np.clip(q, lower, upper) - lower) / (upper - lower) * last
        joints = np.arange(len(lower))
        below, above = np.floor(place).astype(np.int64), np.ceil(place).astype(np.int64)
        return np.asarray(self.survived[joints, below] & self.survived[joints, above])
