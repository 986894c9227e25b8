"""A way through the goals that touches nothing: checked lazily, with detours where needed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.limits import MotionLimits, travel
from ft_manip_ros.core.planning.sequence import choose_postures, straight_time
from ft_manip_ros.core.planning.timing import Motion

# Moves of one goal that may be looked at before it is given up, and via postures of a detour.
_MOVES_PER_GOAL = 24
_VIAS = 12
# Blocked moves to a goal for which a detour is looked for.
_DETOURS = 4


@dataclass(eq=False)
class Way:
    """One posture per goal, with a via posture before it where the straight way is blocked.

    Attributes
    ----------
    kept
        Places, in the list of goals given, of those on the way; the others are cut off.
    picks
        Index of the chosen posture of each kept goal.
    vias
        Via postures, (m,), by place in ``kept``.
    """

    kept: list[int]
    picks: list[int]
    vias: dict[int, Array] = field(default_factory=dict)


class WayFinder:
    """Chooses postures for least time among the moves that are free.

    Parameters
    ----------
    groups
        Postures of the healthy joints for each goal, shape (K_l, m).
    first
        Function that returns the time (s) from the moving start to each posture of a goal.
    extra
        Seconds to add for choosing a posture.
    limits
        Of the healthy joints.
    here : shape (n,)
        Where the full arm would stop.
    healthy : shape (m,)
        Places of the healthy joints in the full arm.
    straight
        For goals that are reached on straight lines, which have been checked, the motions: by
        goal, and by posture of the goal before it and its own.
    """

    def __init__(
        self,
        groups: list[Array],
        first: Callable[[int], Array],
        extra: list[Array],
        limits: MotionLimits,
        here: Array,
        healthy: NDArray[np.intp],
        checker: CollisionChecker | None,
        seed: int,
        straight: Mapping[int, Mapping[tuple[int, int], Motion]],
    ) -> None:
        self._groups, self._first, self._extra = groups, first, extra
        self._limits, self._here, self._healthy = limits, here, healthy
        self._checker, self._straight = checker, straight
        self._rng = np.random.default_rng(seed)
        self._known_first: dict[int, Array] = {}
        # What was found out about moves, by (goal before or -1, its posture, goal, its posture).
        self._free: dict[tuple[int, int, int, int], bool] = {}
        self._vias: dict[tuple[int, int, int, int], Array] = {}

    def find(self) -> Way:
        """Return the fastest free way; goals to which none is found are left out."""
        kept = list(range(len(self._groups)))
        while kept:
            picks, stuck = self._try(kept)
            if stuck is None:
                vias = {}
                for place, move in enumerate(self._moves(kept, picks)):
                    if move in self._vias:
                        vias[place] = self._vias[move]
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
            moves = self._moves(kept, picks)
            if all(self._is_free(move) for move in moves):
                return picks, None
        return [], self._first_unfree(kept)

    def _choose(self, kept: list[int]) -> tuple[list[int], float]:
        first = self._first_times(kept[0]).copy()
        penalties = self._line_penalties(kept)
        for (before, a, goal, b), free in self._free.items():
            if goal not in kept:
                continue
            place = kept.index(goal)
            if (kept[place - 1] if place else -1) != before:
                continue
            penalty = 0.0 if free else self._penalty((before, a, goal, b))
            if place == 0:
                first[b] += penalty
            else:
                penalties[place, a, b] = penalty
        groups = [self._groups[k] for k in kept]
        extra = [self._extra[k] for k in kept]
        return choose_postures(first, groups, self._limits, extra=extra, penalties=penalties)

    def _line_penalties(self, kept: list[int]) -> dict[tuple[int, int, int], float]:
        """What lines take longer than moves straight in joint space; no other way is open."""
        penalties = {}
        for place, goal in enumerate(kept):
            if place == 0 or goal not in self._straight:
                continue
            before, lines = kept[place - 1], self._straight[goal]
            for a, start in enumerate(self._groups[before]):
                for b, end in enumerate(self._groups[goal]):
                    penalties[place, a, b] = float('inf')
                    if before == goal - 1 and (a, b) in lines:
                        penalties[place, a, b] = lines[a, b].duration - self._time(start, end)
        return penalties

    def _first_times(self, goal: int) -> Array:
        if goal not in self._known_first:
            self._known_first[goal] = self._first(goal)
        return self._known_first[goal]

    def _penalty(self, move: tuple[int, int, int, int]) -> float:
        via = self._vias.get(move)
        if via is None:
            return float('inf')
        a, b = self._ends(move)
        return self._time(a, via) + self._time(via, b) - self._time(a, b)

    def _moves(self, kept: list[int], picks: list[int]) -> list[tuple[int, int, int, int]]:
        before = [(-1, 0), *zip(kept, picks, strict=True)]
        return [(*a, *b) for a, b in pairwise(before)]

    def _is_free(self, move: tuple[int, int, int, int]) -> bool:
        """Whether a move is free, straight or by a detour known already; looks once."""
        if self._checker is None or move in self._vias or move[2] in self._straight:
            return True
        if move not in self._free:
            a, b = self._ends(move)
            self._free[move] = not self._touches(a, b)
        return self._free[move]

    def _first_unfree(self, kept: list[int]) -> int:
        """First goal on the way chosen last whose move is not known to be free."""
        picks, _ = self._choose(kept)
        for place, move in enumerate(self._moves(kept, picks)):
            if not (self._free.get(move) or move in self._vias or move[2] in self._straight):
                return kept[place]
        return kept[-1]

    def _first_cut_off(self, kept: list[int]) -> int:
        """First goal that no way leads to."""
        for count in range(1, len(kept)):
            if not np.isfinite(self._choose(kept[:count])[1]):
                return kept[count - 1]
        return kept[-1]

    def _find_detour(self, kept: list[int], goal: int) -> bool:
        """Look for a via posture for the shortest of the blocked moves to a goal."""
        place = kept.index(goal)
        before = kept[place - 1] if place else -1
        blocked = [
            move
            for move, free in self._free.items()
            if not free and move[0] == before and move[2] == goal and move not in self._vias
        ]
        blocked.sort(key=lambda move: self._time(*self._ends(move)))
        return any(self._detour(move) for move in blocked[:_DETOURS])

    def _detour(self, move: tuple[int, int, int, int]) -> bool:
        a, b = self._ends(move)
        m = len(a)
        spread = 0.25 * (self._limits.upper - self._limits.lower)
        tries = [self._here[self._healthy]]
        tries += [0.5 * (a + b) + spread * self._rng.normal(size=m) for _ in range(_VIAS)]
        for via in tries:
            via = np.clip(via, self._limits.lower, self._limits.upper)
            if not self._touches(a, via) and not self._touches(via, b):
                self._vias[move] = via
                return True
        return False

    def _ends(self, move: tuple[int, int, int, int]) -> tuple[Array, Array]:
        before, a, goal, b = move
        start = self._here[self._healthy] if before < 0 else self._groups[before][a]
        return start, start + travel(start, self._groups[goal][b], self._limits.unlimited)

    def _touches(self, a: Array, b: Array) -> bool:
        assert self._checker is not None
        full_a, full_b = self._here.copy(), self._here.copy()
        full_a[self._healthy], full_b[self._healthy] = a, b
        return self._checker.move_touches(full_a, full_b)

    def _time(self, a: Array, b: Array) -> float:
        limits = self._limits
        return float(
            straight_time(
                a, b, limits.unlimited, limits.velocity, limits.acceleration, limits.jerk
            )
        )
