"""How a roadmap grows, in compiled code: RRT-Connect between parts of a graph of free moves."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.ik_types import splitmix, uniform
from ft_manip_ros.core.joint import FULL_TURN
from ft_manip_ros.core.planning.move_scan import ASK, FREE, UNKNOWN, MoveScan, judged

# Longest new move, as part of the ranges of the joints (root of the sum of squares).
STEP = 0.2
# Share of the samples that are nodes of the other side.
_GREED = 0.15
# Nodes of the near side that the wanted postures are first tried from, each.
_NEIGHBOURS = 4

# How growth ended: both sides are joined; enough moves were checked; or one has to be judged.
JOINED, SPENT, ASKS = range(3)

# Places in `Graph.counts` and `Growth.walk`.
NODES, LINKS, CHECKS = range(3)
_AT, _GOAL, _SIDE, _TRIED = range(4)


class Graph(NamedTuple):
    """Postures and the free straight moves between them, with room for more."""

    nodes: Array  # (R, m)
    part: NDArray[np.int64]  # (R,), connected part of each node, by the number of one in it
    links: NDArray[np.int64]  # (S, 2), both ends of each move
    counts: NDArray[np.int64]  # (3,), nodes, links and moves checked so far


class Growth(NamedTuple):
    """Where the search for one way has got to."""

    walk: NDArray[np.int64]  # (4,): node that a walk is at or -1; node that it goes to or -1
    # if a sample; side that grows; and how many first tries were made.
    order: NDArray[np.int64]  # (4,), nodes that an end is first tried from
    target: Array  # (m,), what the walk goes to
    there: Array  # (m,), end of the move in question
    state: NDArray[np.uint64]  # (1,), of the random numbers


@njit(cache=True, nogil=True)
def way_to(a: Array, b: Array, unlimited: NDArray[np.bool_], span: Array, way: Array) -> float:
    """Write the straight way between postures, (m,); return its length by the ranges ``span``."""
    total = 0.0
    for i in range(a.shape[0]):
        way[i] = b[i] - a[i]
        if unlimited[i]:
            way[i] -= round(way[i] / FULL_TURN) * FULL_TURN
        total += (way[i] / span[i]) ** 2
    return math.sqrt(total)


@njit(cache=True, nogil=True)
def _parts(graph: Graph, nodes: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which parts have some of the nodes."""
    parts = np.zeros(graph.counts[NODES], dtype=np.bool_)
    for k in nodes:
        parts[graph.part[k]] = True
    return parts


@njit(cache=True, nogil=True)
def _is_joined(graph: Graph, starts: NDArray[np.int64], ends: NDArray[np.int64]) -> bool:
    parts, joined = _parts(graph, starts), False
    for k in ends:
        joined |= parts[graph.part[k]]
    return joined


@njit(cache=True, nogil=True)
def _write_nearest(
    graph: Graph,
    side: NDArray[np.int64],
    q: Array,
    unlimited: NDArray[np.bool_],
    span: Array,
    out: NDArray[np.int64],
) -> None:
    """Write the nodes that hang together with a side and are nearest to a posture, or -1."""
    parts, way = _parts(graph, side), np.empty(q.shape[0])
    lengths = np.full(out.shape[0], math.inf)
    out[:] = -1
    for k in range(graph.counts[NODES]):
        if not parts[graph.part[k]]:
            continue
        length, node = way_to(graph.nodes[k], q, unlimited, span, way), k
        for place in range(out.shape[0]):
            if length < lengths[place]:
                length, lengths[place] = lengths[place], length
                node, out[place] = out[place], node


@njit(cache=True, nogil=True)
def link(graph: Graph, a: int, b: int) -> None:
    """Take in that the straight move between two nodes is free."""
    graph.links[graph.counts[LINKS], 0] = a
    graph.links[graph.counts[LINKS], 1] = b
    graph.counts[LINKS] += 1
    old, new = graph.part[b], graph.part[a]
    for k in range(graph.counts[NODES]):
        if graph.part[k] == old:
            graph.part[k] = new


@njit(cache=True, nogil=True)
def add(graph: Graph, q: Array) -> int:
    """Take in a free posture, (m,); returns its number."""
    k = graph.counts[NODES]
    graph.nodes[k] = q
    graph.part[k] = k
    graph.counts[NODES] += 1
    return k


@njit(cache=True, nogil=True)
def _random(growth: Growth) -> float:
    growth.state[0] = splitmix(growth.state[0])
    return uniform(growth.state[0])


@njit(cache=True, nogil=True)
def _set_out(
    graph: Graph,
    growth: Growth,
    starts: NDArray[np.int64],
    ends: NDArray[np.int64],
    unlimited: NDArray[np.bool_],
    low: Array,
    span: Array,
) -> None:
    """Choose the next walk: to an end from a node near it at first, then to a random posture."""
    walk, tried = growth.walk, growth.walk[_TRIED]
    if tried < _NEIGHBOURS * ends.shape[0]:
        end = ends[tried // _NEIGHBOURS]
        if tried % _NEIGHBOURS == 0:
            _write_nearest(graph, starts, graph.nodes[end], unlimited, span, growth.order)
        walk[_AT], walk[_GOAL] = growth.order[tried % _NEIGHBOURS], end
        walk[_TRIED] += 1
        growth.target[:] = graph.nodes[end]
        return
    parts, others = _parts(graph, starts), _parts(graph, ends)
    mine = theirs = 0
    for k in range(graph.counts[NODES]):
        mine += parts[graph.part[k]]
        theirs += others[graph.part[k]]
    # The smaller side has more to learn.
    walk[_SIDE] = 1 if theirs < mine else 0
    if _random(growth) < _GREED:
        left = int(_random(growth) * (mine if walk[_SIDE] else theirs))
        wanted = parts if walk[_SIDE] else others
        for k in range(graph.counts[NODES]):
            if wanted[graph.part[k]]:
                if left == 0:
                    growth.target[:] = graph.nodes[k]
                left -= 1
    else:
        for i in range(low.shape[0]):
            growth.target[i] = low[i] + _random(growth) * span[i]
    side = ends if walk[_SIDE] else starts
    _write_nearest(graph, side, growth.target, unlimited, span, growth.order[:1])
    walk[_AT], walk[_GOAL] = growth.order[0], -1


@njit(cache=True, nogil=True)
def grow(
    graph: Graph,
    growth: Growth,
    starts: NDArray[np.int64],
    ends: NDArray[np.int64],
    unlimited: NDArray[np.bool_],
    low: Array,
    span: Array,
    scan: MoveScan,
    answer: int,
    stop_at: int,
) -> int:
    """Grow until a part with a start is one with an end.

    Parameters
    ----------
    graph, growth
        In and out; there is room for a node and a link for every check.
    starts, ends
        Nodes.
    unlimited, low, span : shape (m,)
        Joints that turn without end; the ranges of all, from where and how far.
    answer
        What became of the move that was asked about, from node ``walk[0]`` to ``there``: `FREE`
        or `BLOCKED`; `UNKNOWN` if none was.
    stop_at
        Moves to check in all.

    Returns
    -------
    `JOINED`, `SPENT` or `ASKS`.
    """
    walk, nodes, there = growth.walk, graph.nodes, growth.there
    way = np.empty(low.shape[0])
    while not _is_joined(graph, starts, ends):
        if graph.counts[CHECKS] >= stop_at:
            return SPENT
        if walk[_AT] < 0:
            _set_out(graph, growth, starts, ends, unlimited, low, span)
            if walk[_AT] < 0:
                continue
        at, goal = walk[_AT], walk[_GOAL]
        length = way_to(nodes[at], growth.target, unlimited, span, way)
        if length == 0.0 and goal < 0:
            walk[_AT] = -1
            continue
        part = min(1.0, STEP / length) if length > STEP else 1.0
        for i in range(there.shape[0]):
            there[i] = nodes[at, i] + part * way[i]
        found = answer if answer != UNKNOWN else judged(scan, nodes[at], there)
        if found == ASK:
            return ASKS
        answer = UNKNOWN
        graph.counts[CHECKS] += 1
        if found != FREE:
            walk[_AT] = -1
        elif goal >= 0 and length <= STEP:
            link(graph, at, goal)
            walk[_AT] = -1
        else:
            new = add(graph, there)
            link(graph, at, new)
            if goal >= 0:
                walk[_AT] = new
                continue
            # One step towards a sample; from the other side the walk is to reach the new node.
            other = starts if walk[_SIDE] else ends
            growth.target[:] = there
            _write_nearest(graph, other, there, unlimited, span, growth.order[:1])
            walk[_AT], walk[_GOAL] = growth.order[0], new
    return JOINED
