"""A way through the goals that touches nothing: checked lazily, with detours where needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.planning.lazy_path import ASKS, FOUND, GIVEN_UP, free_path
from ft_manip_ros.core.planning.limits import MotionLimits
from ft_manip_ros.core.planning.move_scan import BLOCKED, FREE
from ft_manip_ros.core.planning.moves import START, Move, Moves

# Moves of one goal that may be looked at before it is given up.
_MOVES_PER_GOAL = 24


@dataclass(eq=False)
class Way:
    """One posture per goal, with others before it where the straight way is blocked.

    Attributes
    ----------
    kept
        Places, in the list of goals given, of those on the way; the others are cut off.
    picks
        Index of the chosen posture of each kept goal.
    vias
        Postures, (V, m), of the detour to a goal, by place in ``kept``.
    """

    kept: list[int]
    picks: list[int]
    vias: dict[int, Array] = field(default_factory=dict)


class _Layers(NamedTuple):
    """Postures of L goals in order, at most K each, as `free_path` has them."""

    between: Array  # (L, K, K), s
    extra: Array  # (L, K), s
    sizes: NDArray[np.int64]  # (L,)
    known: NDArray[np.int8]  # (L, K, K)
    postures: Array  # (L, K, m)


class WayFinder:
    """Chooses postures for least time among the moves that are free.

    Parameters
    ----------
    moves
        Between the postures of the goals.
    count
        Number of goals.
    first
        Function that returns the time (s) from the moving start to each posture of a goal.
    extra
        Function that returns the seconds to add for choosing each posture of a goal.
    limits
        Of the healthy joints.
    more
        Function that looks for further postures of a goal, (K, m), once those known lead nowhere.
    """

    def __init__(
        self,
        moves: Moves,
        count: int,
        first: Callable[[int], Array],
        extra: Callable[[int], Array],
        limits: MotionLimits,
        more: Callable[[int], Array],
    ) -> None:
        self._moves, self._count, self._limits = moves, count, limits
        self._first, self._extra, self._more = first, extra, more
        # By goal and how many of its postures there are: others may be added.
        self._firsts: dict[tuple[int, int], Array] = {}
        self._asked: set[int] = set()

    def find(self) -> Way:
        """Return the fastest free way; goals to which none is found are left out."""
        kept = list(range(self._count))
        while kept:
            picks, stuck = self._try(kept)
            if stuck is None:
                known = self._moves.vias
                places = enumerate(_moves(kept, picks))
                vias = {place: known[move] for place, move in places if move in known}
                return Way(kept, picks, vias)
            kept.remove(stuck)
        return Way([], [])

    def _try(self, kept: list[int]) -> tuple[list[int], int | None]:
        """Postures of a free way through the kept goals, or the goal where it ends."""
        looks = _MOVES_PER_GOAL * len(kept)
        while True:
            layers = self._layers(kept)
            end, path, place, looks = self._search(kept, layers, looks)
            for (before, goal), known in zip(pairwise([START, *kept]), layers.known, strict=True):
                shape = self._moves.added(before, goal).shape
                self._moves.learn(before, goal, known[: shape[0], : shape[1]])
            if end == FOUND:
                return path.tolist(), None
            if end == GIVEN_UP or not self._find_detour(kept, kept[place]):
                return [], kept[place]

    def _search(
        self, kept: list[int], layers: _Layers, looks: int
    ) -> tuple[int, NDArray[np.int64], int, int]:
        """As `free_path`; moves that it asks about are judged."""
        start = self._moves.group(START)[0]
        while True:
            end, path, place, looks = free_path(
                *layers, start, self._limits.unlimited, self._moves.scan, looks
            )
            if end != ASKS:
                return end, path, place, looks
            before, a = (kept[place - 1], path[place - 1]) if place else (START, 0)
            b = path[place]
            blocked = self._moves.move_touches(Move(before, int(a), kept[place], int(b)))
            layers.known[place, a, b] = BLOCKED if blocked else FREE
            if blocked:
                layers.between[place, a, b] = np.inf
                looks -= 1

    def _layers(self, kept: list[int]) -> _Layers:
        """What is known of the postures of the kept goals, and of the moves between them."""
        groups = [self._moves.group(k) for k in kept]
        most = max(map(len, groups))
        sizes = np.array([len(group) for group in groups])
        between = np.full((len(kept), most, most), np.inf)
        known = np.zeros(between.shape, dtype=np.int8)
        extra = np.zeros((len(kept), most))
        postures = np.zeros((len(kept), most, groups[0].shape[1]))
        for place, (before, goal) in enumerate(pairwise([START, *kept])):
            added = self._moves.added(before, goal)
            rows, columns = added.shape
            straight = (
                self._first_times(goal)
                if before == START
                else self._moves.straight_times(before, goal)
            )
            between[place, :rows, :columns] = straight + added
            known[place, :rows, :columns] = self._moves.known(before, goal)
            extra[place, :columns] = self._extra(goal)
            postures[place, :columns] = groups[place]
        return _Layers(between, extra, sizes, known, postures)

    def _first_times(self, goal: int) -> Array:
        """Time (s) from the moving start to each posture of a goal."""
        key = goal, len(self._moves.group(goal))
        if key not in self._firsts:
            self._firsts[key] = self._first(goal)
        return self._firsts[key]

    def _find_detour(self, kept: list[int], goal: int) -> bool:
        """Look for a way round to a goal, to other postures of it if need be."""
        place = kept.index(goal)
        before = kept[place - 1] if place else START
        if self._moves.go_round(before, self._reached(kept[:place]), goal):
            return True
        if goal in self._asked:
            return False
        self._asked.add(goal)
        others = self._more(goal)
        if not len(others):
            return False
        self._moves.extend(goal, others)
        return True

    def _reached(self, kept: list[int]) -> list[int]:
        """Places of the postures of the last of some goals that no known block cuts off."""
        reached = np.zeros(1, dtype=np.intp)
        for before, goal in pairwise([START, *kept]):
            added = self._moves.added(before, goal)[reached]
            reached = np.flatnonzero(np.isfinite(added).any(axis=0))
        return [int(k) for k in reached]


def _moves(kept: list[int], picks: list[int]) -> list[Move]:
    """Moves of a way from where the arm stops."""
    stops = [(START, 0), *zip(kept, picks, strict=True)]
    return [Move(*a, *b) for a, b in pairwise(stops)]
