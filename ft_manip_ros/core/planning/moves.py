"""Moves between the postures of goals: how long they take, which are free, ways round."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.limits import MotionLimits, travel
from ft_manip_ros.core.planning.move_scan import BLOCKED, FREE, UNKNOWN, no_scan
from ft_manip_ros.core.planning.move_times import straight_time, straight_times
from ft_manip_ros.core.planning.roadmap import Roadmap
from ft_manip_ros.core.planning.timing import Motion

# Goal before the first one: where the arm stops; it has one posture.
START = -1
# Part of the checks that are left which one goal may have: there may be others to come.
_SHARE = 0.25


class Move(NamedTuple):
    """From a posture of one goal to one of another, each by its place."""

    before: int
    a: int
    goal: int
    b: int


class Moves:
    """What is known about the moves of one plan; every move is looked at once.

    Parameters
    ----------
    groups
        Postures of the healthy joints for each goal, shape (K_l, m).
    limits
        Of the healthy joints.
    here : shape (n,)
        Where the full arm would stop.
    healthy : shape (m,)
        Places of the healthy joints in the full arm.
    checker
        None: all moves are free.
    straight
        For goals that are reached on straight lines, which have been checked, the motions: by
        goal, and by posture of the goal before it and its own.
    checks
        Moves that may be checked for detours.
    seed
        Of the search for detours.
    """

    def __init__(
        self,
        groups: Sequence[Array],
        limits: MotionLimits,
        here: Array,
        healthy: NDArray[np.intp],
        checker: CollisionChecker | None,
        straight: Mapping[int, Mapping[tuple[int, int], Motion]],
        *,
        checks: int,
        seed: int,
    ) -> None:
        self._groups, self._limits = list(groups), limits
        self._here, self._healthy, self._checker = here, healthy, checker
        self._straight, self._checks = straight, checks
        self.scan = no_scan() if checker is None else checker.scan(here, healthy)
        self._unlinked: list[Move] = []  # free ones that the roadmap has not been told of
        self._added: dict[tuple[int, int], Array] = {}
        self._known: dict[tuple[int, int], NDArray[np.int8]] = {}
        self._times: dict[tuple[int, int], Array] = {}
        self._roadmap = Roadmap(limits, self.touches, self.scan, seed)
        self._nodes: dict[tuple[int, int], int] = {}
        self.vias: dict[Move, Array] = {}  # postures, (V, m), of ways round

    def group(self, goal: int) -> Array:
        """Postures of a goal, (K, m)."""
        return self._here[self._healthy][None, :] if goal == START else self._groups[goal]

    def extend(self, goal: int, postures: Array) -> None:
        """Take in further postures, (K, m), of a goal."""
        self._groups[goal] = np.vstack([self._groups[goal], postures])
        self._times = {pair: times for pair, times in self._times.items() if goal not in pair}
        more = len(postures)
        for pair in [pair for pair in self._added if goal in pair]:
            room = (0, more * (pair[0] == goal)), (0, more * (pair[1] == goal))
            self._added[pair] = np.pad(self._added[pair], room)
            self._known[pair] = np.pad(self._known[pair], room, constant_values=UNKNOWN)

    def added(self, before: int, goal: int) -> Array:
        """Seconds that moves take longer than straight ones, (K_before, K); infinite if blocked.

        Those that nothing is known about count as free.
        """
        key = before, goal
        if key not in self._added:
            starts, ends = self.group(before), self.group(goal)
            shape = len(starts), len(ends)
            self._added[key] = np.zeros(shape)
            sure = self._checker is None or goal in self._straight
            self._known[key] = np.full(shape, FREE if sure else UNKNOWN, dtype=np.int8)
            if goal in self._straight and before != START:
                # Only lines lead there, from the goal before it alone.
                self._added[key][:] = np.inf
                for (a, b), line in self._straight[goal].items() if before == goal - 1 else ():
                    self._added[key][a, b] = line.duration - self.time(starts[a], ends[b])
        return self._added[key]

    def straight_times(self, before: int, goal: int) -> Array:
        """Seconds that straight moves take from rest to rest, (K_before, K)."""
        key = before, goal
        if key not in self._times:
            self._times[key] = straight_times(self.group(before), self.group(goal), self._limits)
        return self._times[key]

    def known(self, before: int, goal: int) -> NDArray[np.int8]:
        """What is known of the moves, (K_before, K): `UNKNOWN`, `FREE` or `BLOCKED`."""
        self.added(before, goal)
        return self._known[before, goal]

    def learn(self, before: int, goal: int, known: NDArray[np.int8]) -> None:
        """Take in what was found out about moves, (K_before, K)."""
        old, added = self.known(before, goal), self.added(before, goal)
        new = (old == UNKNOWN) & (known != UNKNOWN)
        added[new & (known == BLOCKED)] = np.inf
        free = np.argwhere(new & (known == FREE)).tolist()
        self._unlinked += [Move(before, a, goal, b) for a, b in free]
        old[new] = known[new]

    def go_round(self, before: int, starts: Sequence[int], goal: int) -> bool:
        """Look for a way round from one of some postures of a goal to one of the next."""
        checks = int(_SHARE * (self._checks - self._roadmap.checks))
        if self._checker is None or goal in self._straight or checks <= 0:
            return False
        begins = {self._node(before, a): a for a in starts}
        ends = {self._node(goal, b): b for b in range(len(self._groups[goal]))}
        for known in self._unlinked:
            self._roadmap.link(self._node(*known[:2]), self._node(*known[2:]))
        self._unlinked.clear()
        found = self._roadmap.way(list(begins), list(ends), checks)
        if found is None:
            return False
        move = Move(before, begins[found[0]], goal, ends[found[-1]])
        longer = 0.0
        if len(found) > 2:
            vias = np.array([self._roadmap.at(node) for node in found[1:-1]])
            a, b = self._ends(move)
            longer = sum(self.time(*leg) for leg in pairwise([a, *vias, b])) - self.time(a, b)
            self.vias[move] = vias
        self.added(before, goal)[move.a, move.b] = longer
        self.known(before, goal)[move.a, move.b] = FREE
        return True

    def time(self, a: Array, b: Array) -> float:
        """Time (s) of the straight move between two rests."""
        limits = self._limits
        return float(
            straight_time(
                a, b, limits.unlimited, limits.velocity, limits.acceleration, limits.jerk
            )
        )

    def _node(self, goal: int, place: int) -> int:
        """Number of a posture in the roadmap."""
        key = goal, place
        if key not in self._nodes:
            self._nodes[key] = self._roadmap.add(self.group(goal)[place])
        return self._nodes[key]

    def _ends(self, move: Move) -> tuple[Array, Array]:
        start = self.group(move.before)[move.a]
        end = self.group(move.goal)[move.b]
        return start, start + travel(start, end, self._limits.unlimited)

    def move_touches(self, move: Move) -> bool:
        """Tell whether anything touches on a move."""
        return self.touches(*self._ends(move))

    def touches(self, a: Array, b: Array) -> bool:
        """Tell whether anything touches on the straight move between two postures, (m,)."""
        assert self._checker is not None
        full_a, full_b = self._here.copy(), self._here.copy()
        full_a[self._healthy], full_b[self._healthy] = a, b
        return self._checker.move_touches(full_a, full_b)
