"""Put goals in another order: a shorter way (nearest goal, then 2-opt), or safest first."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.planning.limits import MotionLimits
from ft_manip_ros.core.planning.move_times import straight_times


def fastest_order(first: Array, groups: list[Array], limits: MotionLimits) -> list[int]:
    """Order in which visiting the goals takes little time; not always the least.

    Between two goals the nearest pair of their postures counts; which posture is taken in the
    end is chosen afterwards, for the whole way.

    Parameters
    ----------
    first : shape (L,)
        Least time (s) from the start to each goal.
    groups
        The postures of each goal, shape (K_l, m).
    """
    count = len(groups)
    times = np.zeros((count, count))
    for i in range(count):
        for j in range(i):
            times[i, j] = times[j, i] = straight_times(groups[i], groups[j], limits).min()
    order = [int(np.argmin(first))]
    while len(order) < count:
        left = [k for k in range(count) if k not in order]
        order.append(min(left, key=lambda k: times[order[-1], k]))
    return _without_crossings(order, first, times)


def _without_crossings(order: list[int], first: Array, times: Array) -> list[int]:
    """Reverse pieces of the order as long as that saves time (2-opt)."""

    def cost(candidate: list[int]) -> float:
        legs = sum(times[a, b] for a, b in pairwise(candidate))
        return float(first[candidate[0]] + legs)

    best = cost(order)
    improved = True
    while improved:
        improved = False
        for i in range(len(order) - 1):
            for j in range(i + 2, len(order) + 1):
                candidate = order[:i] + order[i:j][::-1] + order[j:]
                # Rounding must not keep the search going round in circles.
                if (total := cost(candidate)) < best - 1e-9:
                    order, best, improved = candidate, total, True
    return order


def safest_order(margins: Array) -> list[int]:
    """Order by falling margin; goals of equal margin keep theirs."""
    return [int(k) for k in np.argsort(-margins, kind='stable')]
