"""A way through the goals that touches nothing: checked lazily, with detours where needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.planning.limits import MotionLimits
from ft_manip_ros.core.planning.moves import START, Move, Moves
from ft_manip_ros.core.planning.sequence import choose_postures

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
        self._known_first: dict[int, Array] = {}
        self._known_extra: dict[int, Array] = {}
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
        for _ in range(_MOVES_PER_GOAL * len(kept)):
            picks, total = self._choose(kept)
            if not np.isfinite(total):
                goal = self._first_cut_off(kept)
                if not self._find_detour(kept, goal):
                    return [], goal
                continue
            if all(self._moves.is_free(move) for move in _moves(kept, picks)):
                return picks, None
        return [], self._first_unfree(kept)

    def _choose(self, kept: list[int]) -> tuple[list[int], float]:
        for goal in kept:
            if goal not in self._known_extra:
                self._known_extra[goal] = self._extra(goal)
        if kept[0] not in self._known_first:
            self._known_first[kept[0]] = self._first(kept[0])
        return choose_postures(
            self._known_first[kept[0]] + self._moves.added(START, kept[0])[0],
            [self._moves.group(k) for k in kept],
            self._limits,
            extra=[self._known_extra[k] for k in kept],
            penalties=[self._moves.added(*pair) for pair in pairwise(kept)],
        )

    def _first_unfree(self, kept: list[int]) -> int:
        """First goal on the way chosen last whose move is not known to be free."""
        picks, _ = self._choose(kept)
        for place, move in enumerate(_moves(kept, picks)):
            if not self._moves.is_known_free(move):
                return kept[place]
        return kept[-1]

    def _first_cut_off(self, kept: list[int]) -> int:
        """First goal that no way leads to."""
        for count in range(1, len(kept)):
            if not np.isfinite(self._choose(kept[:count])[1]):
                return kept[count - 1]
        return kept[-1]

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
        self._known_first.pop(goal, None)
        self._known_extra.pop(goal, None)
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
