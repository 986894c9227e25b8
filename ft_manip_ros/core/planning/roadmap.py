"""Ways round what is in the way: a roadmap of free moves that grows where it is asked for one."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.joint import FULL_TURN
from ft_manip_ros.core.planning import roadmap_growth as growth
from ft_manip_ros.core.planning.limits import MotionLimits, travel
from ft_manip_ros.core.planning.move_scan import ASK, BLOCKED, FREE, UNKNOWN, MoveScan, judged
from ft_manip_ros.core.planning.roadmap_growth import CHECKS, LINKS, NODES, Graph, Growth

# Room for nodes and links at first.
_ROOM = 256


class Roadmap:
    """Postures of the healthy joints and free straight moves between them.

    It grows as RRT-Connect does (Kuffner & LaValle, ICRA 2000), but from all postures at once
    that are known to hang together with the wanted ends, and keeps what it has learnt for the
    next question. The same questions in the same order have the same answers.

    Parameters
    ----------
    limits
        Of the m healthy joints.
    touches
        Tells whether anything touches on the straight move between two postures, (m,).
    scan
        Tells the same in compiled code, or leaves it to ``touches``.
    seed
        Of the samples.
    """

    def __init__(
        self,
        limits: MotionLimits,
        touches: Callable[[Array, Array], bool],
        scan: MoveScan,
        seed: int,
    ) -> None:
        self._limits, self._touches, self._scan = limits, touches, scan
        self._low = np.where(limits.unlimited, -0.5 * FULL_TURN, limits.lower)
        self._span = np.where(limits.unlimited, FULL_TURN, limits.upper - limits.lower)
        self._state = np.array([seed], dtype=np.uint64)
        self._graph = Graph(
            np.zeros((_ROOM, len(self._low))),
            np.zeros(_ROOM, dtype=np.int64),
            np.zeros((_ROOM, 2), dtype=np.int64),
            np.zeros(3, dtype=np.int64),
        )

    @property
    def checks(self) -> int:
        """Moves checked so far."""
        return int(self._graph.counts[CHECKS])

    def add(self, q: Array) -> int:
        """Take in a free posture, (m,); returns its number."""
        self._make_room(1)
        return int(growth.add(self._graph, np.ascontiguousarray(q)))

    def link(self, a: int, b: int) -> None:
        """Take in that the straight move between two nodes is free."""
        self._make_room(1)
        growth.link(self._graph, a, b)

    def way(self, starts: Sequence[int], ends: Sequence[int], checks: int) -> list[int] | None:
        """Nodes of a free way from one of some nodes to one of others.

        Parameters
        ----------
        checks
            Moves that may be checked to find one; a few more make it short.

        Returns
        -------
        None where none was found, which proves nothing.
        """
        if not len(starts) or not len(ends):
            return None
        if not self._grow_together(np.array(starts), np.array(ends), self.checks + checks):
            return None
        links = self._neighbours()
        return self._straightened(_shortest(links, starts, ends), links)

    def at(self, node: int) -> Array:
        """Posture, (m,), of a node."""
        return self._graph.nodes[node].copy()

    def _grow_together(
        self, starts: NDArray[np.int64], ends: NDArray[np.int64], stop_at: int
    ) -> bool:
        """Grow until a part with a start is one with an end."""
        self._make_room(stop_at - self.checks)
        m = len(self._low)
        search = Growth(
            np.array([-1, -1, 0, 0]),
            np.full(4, -1),
            np.zeros(m),
            np.zeros(m),
            self._state,
        )
        answer = UNKNOWN
        while True:
            end = growth.grow(
                self._graph,
                search,
                starts,
                ends,
                self._limits.unlimited,
                self._low,
                self._span,
                self._scan,
                answer,
                stop_at,
            )
            if end != growth.ASKS:
                return bool(end == growth.JOINED)
            here = self._graph.nodes[search.walk[0]].copy()
            answer = BLOCKED if self._touches(here, search.there.copy()) else FREE

    def _make_room(self, more: int) -> None:
        """See to it that there is room for so many more nodes and links."""
        nodes, part, links, counts = self._graph
        if counts[NODES] + more > len(nodes):
            room = len(nodes) + more
            nodes, part = (
                np.concatenate([x, np.zeros((room, *x.shape[1:]), x.dtype)]) for x in (nodes, part)
            )
        if counts[LINKS] + more > len(links):
            links = np.concatenate([links, np.zeros((len(links) + more, 2), links.dtype)])
        self._graph = Graph(nodes, part, links, counts)

    def _is_free(self, a: int, b: int) -> bool:
        start, end = self.at(a), self.at(b)
        end = start + travel(start, end, self._limits.unlimited)
        self._graph.counts[CHECKS] += 1
        said = judged(self._scan, start, end)
        return not self._touches(start, end) if said == ASK else said == FREE

    def _neighbours(self) -> list[dict[int, float]]:
        """Lengths of the moves from each node to those that are linked to it."""
        nodes, _, links, counts = self._graph
        links = links[: counts[LINKS]]
        ways = travel(nodes[links[:, 0]], nodes[links[:, 1]], self._limits.unlimited)
        lengths = np.linalg.norm(ways / self._span, axis=1)
        found: list[dict[int, float]] = [{} for _ in range(counts[NODES])]
        for (a, b), length in zip(links.tolist(), lengths.tolist(), strict=True):
            found[a][b] = found[b][a] = length
        return found

    def _straightened(self, way: list[int], links: list[dict[int, float]]) -> list[int]:
        """The same way with all nodes left out that a free straight move can pass by."""
        kept = [way[0]]
        place = 0
        while place < len(way) - 1:
            for ahead in range(len(way) - 1, place, -1):
                a, b = kept[-1], way[ahead]
                if b in links[a] or self._is_free(a, b):
                    self.link(a, b)
                    kept.append(b)
                    place = ahead
                    break
        return kept


def _shortest(
    links: list[dict[int, float]], starts: Sequence[int], ends: Sequence[int]
) -> list[int]:
    """Nodes of the shortest way along the links (Dijkstra)."""
    came: dict[int, int] = {}
    queue = [(0.0, start, start) for start in starts]
    heapq.heapify(queue)
    while queue:
        length, node, before = heapq.heappop(queue)
        if node in came:
            continue
        came[node] = before
        if node in ends:
            way = [node]
            while came[way[-1]] != way[-1]:
                way.append(came[way[-1]])
            return way[::-1]
        for after, more in links[node].items():
            heapq.heappush(queue, (length + more, after, node))
    raise AssertionError('the parts are joined')
