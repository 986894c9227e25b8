"""Every choice of k frozen joints, and the grid of angles at which each is tried."""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
from numba import njit

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.design.dh_kernels import IntArray, Limits


class FrozenSets(NamedTuple):
    """Every choice of k frozen joints, and the grid of angles at which each is tried."""

    frozen: IntArray  # (S, k)
    free: IntArray  # (S, n-k)
    angles: Array  # (n, K), rad, each joint's grid over its operating limits


def frozen_sets(limits: Limits, order: int, nodes: int) -> FrozenSets:
    """Return all k-subsets of the joints with ``nodes`` angles per frozen joint."""
    n = len(limits.lower)
    chosen = list(combinations(range(n), order))
    free = [[j for j in range(n) if j not in subset] for subset in chosen]
    angles = np.linspace(limits.freeze_lower, limits.freeze_upper, nodes, axis=1)
    return FrozenSets(
        np.array(chosen, dtype=np.int64),
        np.array(free, dtype=np.int64),
        np.ascontiguousarray(angles),
    )


@njit(cache=True, nogil=True)
def node_angles(sets: FrozenSets, subset: int, node: int, q: Array) -> None:
    """Write the frozen angles of grid node ``node`` into ``q`` (first frozen joint slowest)."""
    nodes = sets.angles.shape[1]
    rest = node
    for k in range(sets.frozen.shape[1] - 1, -1, -1):
        j = sets.frozen[subset, k]
        q[j] = sets.angles[j, rest % nodes]
        rest //= nodes
