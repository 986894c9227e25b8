"""Fastest path through the postures of goals, whose moves are looked at when it comes to them."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.joint import FULL_TURN
from ft_manip_ros.core.planning.move_scan import ASK, BLOCKED, FREE, UNKNOWN, MoveScan, judged

# How the search ended: with a path all of whose moves are free; without any; with a move that
# somebody else has to judge; or after too many looks.
FOUND, CUT_OFF, ASKS, GIVEN_UP = range(4)


@njit(cache=True, nogil=True)
def cheapest_path(
    between: Array, extra: Array, sizes: NDArray[np.int64]
) -> tuple[NDArray[np.int64], float, int]:
    """Pick one posture in each layer for least total time, by dynamic programming (Viterbi).

    Parameters
    ----------
    between : shape (L, K, K)
        Time (s) of the move from a posture of the layer before to one of this; infinite where
        it is blocked. Before the first layer stands a single posture.
    extra : shape (L, K)
        Seconds to add for choosing a posture.
    sizes : shape (L,)
        Postures in each layer, at most K.

    Returns
    -------
    path : shape (L,)
        Indices of the postures.
    total
        Its time (s); infinite where every path is blocked.
    cut
        First layer that no path leads to, else L.
    """
    layers, most = extra.shape
    cost = np.full((layers + 1, most), math.inf)
    came = np.zeros((layers, most), dtype=np.int64)
    cost[0, 0] = 0.0
    cut = layers
    for layer in range(layers):
        reached = False
        for k in range(sizes[layer]):
            least = math.inf
            for before in range(1 if layer == 0 else sizes[layer - 1]):
                total = cost[layer, before] + between[layer, before, k]
                if total < least:
                    least = total
                    came[layer, k] = before
            cost[layer + 1, k] = least + extra[layer, k]
            reached |= least < math.inf
        if not reached and cut == layers:
            cut = layer
    path = np.zeros(layers, dtype=np.int64)
    path[-1] = np.argmin(cost[-1, : sizes[-1]])
    total = cost[-1, path[-1]]
    for layer in range(layers - 1, 0, -1):
        path[layer - 1] = came[layer, path[layer]]
    return path, total, cut


@njit(cache=True, nogil=True)
def free_path(
    between: Array,
    extra: Array,
    sizes: NDArray[np.int64],
    known: NDArray[np.int8],
    postures: Array,
    start: Array,
    unlimited: NDArray[np.bool_],
    scan: MoveScan,
    looks: int,
) -> tuple[int, NDArray[np.int64], int, int]:
    """Find the fastest path that touches nothing.

    Parameters as for `cheapest_path`, and what is found out about moves is written to them.

    Parameters
    ----------
    known : shape (L, K, K), in and out
        `UNKNOWN`, `FREE` or `BLOCKED`.
    postures : shape (L, K, m)
    start : shape (m,)
        The posture before the first layer.
    looks
        Paths to look at before the search is given up.

    Returns
    -------
    end
        `FOUND`, `CUT_OFF`, `ASKS` or `GIVEN_UP`.
    path : shape (L,)
    layer
        The one that is cut off, whose move has to be judged, or whose move is not known free.
    looks
        Those that are left; one that is asked about counts if the move turns out to be blocked.
    """
    while looks > 0:
        path, total, cut = cheapest_path(between, extra, sizes)
        if total == math.inf:
            return CUT_OFF, path, cut, looks - 1
        layer = _judge_path(between, known, start, postures, unlimited, scan, path)
        if layer == path.shape[0]:
            return FOUND, path, layer, looks - 1
        at = 0 if layer == 0 else path[layer - 1]
        if known[layer, at, path[layer]] == UNKNOWN:
            return ASKS, path, layer, looks
        looks -= 1
    path, _, _ = cheapest_path(between, extra, sizes)
    for layer in range(path.shape[0]):
        at = 0 if layer == 0 else path[layer - 1]
        if known[layer, at, path[layer]] != FREE:
            return GIVEN_UP, path, layer, 0
    return GIVEN_UP, path, path.shape[0] - 1, 0


@njit(cache=True, nogil=True)
def _judge_path(
    between: Array,
    known: NDArray[np.int8],
    start: Array,
    postures: Array,
    unlimited: NDArray[np.bool_],
    scan: MoveScan,
    path: NDArray[np.int64],
) -> int:
    """First layer of a path whose move is not free; its length where all are."""
    end = np.empty(start.shape[0])
    for layer in range(path.shape[0]):
        at = 0 if layer == 0 else path[layer - 1]
        to = path[layer]
        if known[layer, at, to] == UNKNOWN:
            a = start if layer == 0 else postures[layer - 1, at]
            for i in range(end.shape[0]):
                way = postures[layer, to, i] - a[i]
                if unlimited[i]:
                    way -= round(way / FULL_TURN) * FULL_TURN
                end[i] = a[i] + way
            found = judged(scan, a, end)
            if found == ASK:
                return layer
            known[layer, at, to] = found
            if found == BLOCKED:
                between[layer, at, to] = math.inf
        if known[layer, at, to] == BLOCKED:
            return layer
    return path.shape[0]
