"""Ways round what is in the way: a roadmap of free moves that grows where it is asked for one."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.joint import FULL_TURN
from ft_manip_ros.core.planning.limits import MotionLimits, travel

# Longest new move, as part of the ranges of the joints (root of the sum of squares).
_STEP = 0.2
# Share of the samples that are nodes of the other side.
_GREED = 0.15
# Nodes of the near side that the wanted postures are first tried from, each.
_NEIGHBOURS = 4


@njit(cache=True, nogil=True)
def _write_lengths(
    nodes: Array, q: Array, unlimited: NDArray[np.bool_], span: Array, out: Array
) -> None:
    """Lengths of the straight moves from some postures, (K, m), to another one, by ranges."""
    for k in range(nodes.shape[0]):
        total = 0.0
        for i in range(q.shape[0]):
            way = q[i] - nodes[k, i]
            if unlimited[i]:
                way -= round(way / FULL_TURN) * FULL_TURN
            total += (way / span[i]) ** 2
        out[k] = math.sqrt(total)


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
    rng
        Of the samples.

    Attributes
    ----------
    checks
        Moves checked so far.
    """

    def __init__(
        self,
        limits: MotionLimits,
        touches: Callable[[Array, Array], bool],
        rng: np.random.Generator,
    ) -> None:
        self._limits, self._touches, self._rng = limits, touches, rng
        self._low = np.where(limits.unlimited, -0.5 * FULL_TURN, limits.lower)
        self._span = np.where(limits.unlimited, FULL_TURN, limits.upper - limits.lower)
        self._nodes: Array = np.empty((0, len(limits.lower)))
        self._links: list[dict[int, float]] = []
        self._part: NDArray[np.intp] = np.empty(0, dtype=np.intp)  # connected part of each node
        self.checks = 0
        self._stop_at = 0

    def add(self, q: Array) -> int:
        """Take in a free posture, (m,); returns its number."""
        k = len(self._nodes)
        self._nodes = np.vstack([self._nodes, q])
        self._part = np.append(self._part, k)
        self._links.append({})
        return k

    def link(self, a: int, b: int) -> None:
        """Take in that the straight move between two nodes is free."""
        self._links[a][b] = self._links[b][a] = self._length(a, b)
        self._part[self._part == self._part[b]] = self._part[a]

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
        self._stop_at = self.checks + checks
        if not self._grow_together(starts, ends):
            return None
        return self._straightened(self._shortest(starts, ends))

    def at(self, node: int) -> Array:
        """Posture, (m,), of a node."""
        return self._nodes[node]

    def _grow_together(self, starts: Sequence[int], ends: Sequence[int]) -> bool:
        """Grow until a part with a start is one with an end."""
        for end in ends:
            order = self._nearest(self._side(starts), self._nodes[end])
            for near in order[:_NEIGHBOURS]:
                if self._joined(starts, ends):
                    return True
                if self.checks < self._stop_at:
                    self._reach_out(int(near), end)
        sides = [starts, ends]
        while not self._joined(starts, ends) and self.checks < self._stop_at:
            # The smaller side has more to learn.
            sides.sort(key=lambda side: int(self._side(side).sum()))
            self._step(sides[0], sides[1])
        return self._joined(starts, ends)

    def _step(self, side: Sequence[int], other: Sequence[int]) -> None:
        if self._rng.random() < _GREED:
            target = self._nodes[self._rng.choice(np.flatnonzero(self._side(other)))]
        else:
            target = self._low + self._rng.random(len(self._span)) * self._span
        near = int(self._nearest(self._side(side), target)[0])
        new = self._extend(near, target)
        if new is not None:
            self._reach_out(int(self._nearest(self._side(other), self._nodes[new])[0]), new)

    def _reach_out(self, node: int, goal: int) -> None:
        """Go from a node to another one in steps, as far as they are free."""
        target = self._nodes[goal]
        at: int | None = node
        while at is not None and self.checks < self._stop_at:
            if self._length(at, goal) <= _STEP:
                if self._is_free(self._nodes[at], target):
                    self.link(at, goal)
                return
            at = self._extend(at, target)

    def _extend(self, node: int, target: Array) -> int | None:
        """Make one step from a node towards a posture; returns the new node if it is free."""
        here = self._nodes[node]
        way = travel(here, target, self._limits.unlimited)
        length = float(self._lengths(here[None, :], target)[0])
        if length == 0.0:
            return None
        there = here + way * min(1.0, _STEP / length)
        if not self._is_free(here, there):
            return None
        new = self.add(there)
        self.link(node, new)
        return new

    def _is_free(self, a: Array, b: Array) -> bool:
        self.checks += 1
        return not self._touches(a, a + travel(a, b, self._limits.unlimited))

    def _side(self, nodes: Sequence[int]) -> NDArray[np.bool_]:
        """Which nodes hang together with some."""
        # Parts go by the number of one of their nodes.
        wanted = np.zeros(len(self._part), dtype=np.bool_)
        wanted[self._part[list(nodes)]] = True
        return wanted[self._part]

    def _joined(self, starts: Sequence[int], ends: Sequence[int]) -> bool:
        return not set(self._part[list(ends)]).isdisjoint(self._part[list(starts)])

    def _nearest(self, among: NDArray[np.bool_], q: Array) -> NDArray[np.intp]:
        """Nodes in order of their distance from a posture."""
        places = np.flatnonzero(among)
        return places[np.argsort(self._lengths(self._nodes[places], q), kind='stable')]

    def _lengths(self, nodes: Array, q: Array) -> Array:
        out = np.empty(len(nodes))
        _write_lengths(nodes, q, self._limits.unlimited, self._span, out)
        return out

    def _length(self, a: int, b: int) -> float:
        return float(self._lengths(self._nodes[a : a + 1], self._nodes[b])[0])

    def _shortest(self, starts: Sequence[int], ends: Sequence[int]) -> list[int]:
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
            for after, more in self._links[node].items():
                heapq.heappush(queue, (length + more, after, node))
        raise AssertionError('the parts are joined')

    def _straightened(self, way: list[int]) -> list[int]:
        """The same way with all nodes left out that a free straight move can pass by."""
        kept = [way[0]]
        place = 0
        while place < len(way) - 1:
            for ahead in range(len(way) - 1, place, -1):
                a, b = kept[-1], way[ahead]
                if b in self._links[a] or self._is_free(self._nodes[a], self._nodes[b]):
                    self.link(a, b)
                    kept.append(b)
                    place = ahead
                    break
        return kept
