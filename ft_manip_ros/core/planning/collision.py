"""Collision along whole motions, by bisection: nothing is passed unseen between two looks."""

from __future__ import annotations

import numpy as np
import pinocchio
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.planning.approach import approaches
from ft_manip_ros.core.planning.bounding import bounding_bodies
from ft_manip_ros.core.planning.clearance import NO_ROOM, TOUCH, scan_move, scan_posture
from ft_manip_ros.core.planning.collision_model import CollisionModel
from ft_manip_ros.core.planning.move_scan import MoveScan

# Halvings of a move after which what is still too near to tell apart counts as touching.
_HALVINGS = 12
# Room for open pieces of a move at first.
_PIECES = 256
# What the distance of two bodies may be wrong by: coal ends its search at 1e-6 m.
_DISTANCE_ERROR = 2e-6


class CollisionChecker:
    """Judges postures and straight joint-space moves of one arm among its obstacles.

    Capsules around the bodies settle most pairs in compiled code; the distances of the others
    are asked of coal. Not to be used from two threads at once.

    Parameters
    ----------
    bodies
        The arm and what is around it.
    """

    def __init__(self, bodies: CollisionModel) -> None:
        self.bodies = bodies
        self._data = bodies.model.createData()
        self._places = bodies.geometry.createData()
        self._bounding = bounding_bodies(bodies)
        self._approach = approaches(self._bounding, bodies.chain)
        self._slides = np.zeros(bodies.chain.n)
        for axis in bodies.chain.axes:
            self._slides[axis.joint] += abs(axis.ratio) * axis.prismatic
        self._pairs = [(pair.first, pair.second) for pair in bodies.geometry.collisionPairs]
        self._padding = np.full(len(self._pairs), bodies.padding)
        self._checked: NDArray[np.int64] = np.arange(len(self._pairs))
        self._open = np.zeros(max(_PIECES, len(self._pairs)), dtype=np.int64)
        self._pieces = np.zeros((len(self._open), 2))
        # Compiled now, not after a failure.
        middle = 0.5 * (bodies.chain.lower + bodies.chain.upper)
        self._box_is_free(middle, middle)
        self.move_touches(middle, middle)

    def allow_at(self, q: Array) -> tuple[tuple[str, str], ...]:
        """Stop checking the arm's own bodies that touch at a posture against each other.

        The arm stands there, so such a pair touches in its model only: through padding, or hulls
        that are wider than the bodies. Obstacles go on being checked. Forgets what an earlier
        call allowed. Returns the names of the pairs.
        """
        self._checked = np.arange(len(self._pairs))
        own = self.bodies.own
        allowed = [k for k in self._touching_pairs(q) if max(self._pairs[k]) < own]
        self._checked = np.setdiff1d(self._checked, allowed)
        return tuple(self._names(k) for k in allowed)

    def touches(self, q: Array) -> bool:
        """Tell whether bodies come nearer than the padding at a posture, shape (n,)."""
        count = self._scan(q, self._padding)
        if count <= 0:
            return count == TOUCH
        self._place(q)
        return any(self._gap(int(k)) <= 0.0 for k in self._open[:count])

    def touching(self, q: Array) -> tuple[str, str] | None:
        """Return the names of two bodies nearer than the padding at a posture, or None."""
        pairs = self._touching_pairs(q)
        return self._names(pairs[0]) if pairs else None

    def what_touches(self, *postures: Array) -> str:
        """Name two bodies that touch in the first of some postures in which any do."""
        pair = next((pair for q in postures if (pair := self.touching(q))), ('bodies',))
        return f'{" and ".join(pair)} touch'

    def move_touches(self, a: Array, b: Array) -> bool:
        """Tell whether anything touches on the straight joint-space move from a to b, (n,).

        Around the middle of a piece of the move, no two bodies approach each other by more than
        the joints between them can move the outer one in half the piece. Where all are farther
        apart than that (and the padding), the whole piece is free; else it is halved.
        """
        padding = self.bodies.padding
        approach = self._approach_within(np.minimum(a, b), np.maximum(a, b))
        s, t = self._axes(a), self._axes(b)
        while True:
            count = scan_move(
                self._bounding,
                s,
                t,
                self._checked,
                approach,
                padding,
                _HALVINGS,
                self._pieces,
                self._open,
            )
            if count != NO_ROOM:
                break
            self._open = np.zeros(2 * len(self._open), dtype=np.int64)
            self._pieces = np.zeros((len(self._open), 2))
        if count <= 0:
            return count == TOUCH
        pieces, pairs = self._pieces[:count].tolist(), self._open[:count].tolist()
        return any(
            self._piece_touches(a, b, k, float(approach[k]), *piece)
            for k, piece in zip(pairs, pieces, strict=True)
        )

    def scan(self, here: Array, healthy: NDArray[np.intp]) -> MoveScan:
        """Return what compiled searches need to judge moves, as far as capsules and hulls do.

        It counts until the next call of a method of this. Parameters as for `Moves`.
        """
        chain = self.bodies.chain
        return MoveScan(
            True,
            self._bounding,
            self._checked,
            self._approach,
            self._slides,
            chain.lower.copy(),
            chain.upper.copy(),
            chain.arrays.driver,
            chain.arrays.ratio,
            here.copy(),
            healthy.copy(),
            float(self.bodies.padding),
            _HALVINGS,
            self._pieces,
            self._open,
        )

    def first_touch(self, times: Array, positions: Array) -> float | None:
        """Time (s) from which a motion touches something, or None.

        Between two of its samples, (T,) and (T, n), it is taken as straight in joint space.
        """
        spans = [(0, len(times) - 1)]
        while spans:
            begin, end = spans.pop()
            part = positions[begin : end + 1]
            if begin == end or self._box_is_free(part.min(axis=0), part.max(axis=0)):
                continue
            if end - begin > 1:
                middle = (begin + end) // 2
                spans += [(middle, end), (begin, middle)]
            elif self.move_touches(part[0], part[1]):
                return float(times[begin])
        return None

    def _box_is_free(self, low: Array, high: Array) -> bool:
        """Tell whether capsules prove all postures between two free, joint by joint."""
        wanted = self.bodies.padding + 0.5 * self._approach_within(low, high)
        return self._scan(0.5 * (low + high), wanted) == 0

    def _approach_within(self, low: Array, high: Array) -> Array:
        """How far (m) the bodies of each pair, (P,), approach on a way between two postures."""
        way = high - low
        approach = self._approach @ way
        if self._slides.any():
            # A frozen joint may have slid beyond its range, and swings what it carries wider.
            chain = self.bodies.chain
            beyond = np.maximum(np.maximum(chain.lower - low, high - chain.upper), 0.0)
            approach += (self._slides @ beyond) * ((self._approach > 0.0) @ way)
        return np.asarray(approach)

    def _piece_touches(
        self, a: Array, b: Array, pair: int, approach: float, begin: float, end: float
    ) -> bool:
        """Tell whether a pair touches between two parts, 0 to 1, of a move."""
        pieces = [(begin, end)]
        while pieces:
            begin, end = pieces.pop()
            middle = 0.5 * (begin + end)
            self._place(a + middle * (b - a))
            gap = self._gap(pair)
            if gap <= 0.0:
                return True
            # So far on both sides of the middle nothing can touch.
            free = gap / approach if approach > 0.0 else 1.0
            if middle - free < begin:
                continue
            if end - begin < 0.5**_HALVINGS:
                return True
            pieces += [(middle + free, end), (begin, middle - free)]
        return False

    def _touching_pairs(self, q: Array) -> list[int]:
        """Pairs nearer than the padding at a posture."""
        if self._scan(q, self._padding) == 0:
            return []
        self._place(q)
        return [int(k) for k in self._checked if self._gap(int(k)) <= 0.0]

    def _scan(self, q: Array, wanted: Array) -> int:
        """Pairs that may be nearer than wanted, (P,), written into ``_open``, or `TOUCH`."""
        return int(scan_posture(self._bounding, self._axes(q), self._checked, wanted, self._open))

    def _axes(self, q: Array) -> Array:
        """Axis positions, of one kind of array: for others the kernels would be compiled anew."""
        return np.array(self.bodies.chain.axis_positions(q))

    def _place(self, q: Array) -> None:
        bodies = self.bodies
        pinocchio.updateGeometryPlacements(
            bodies.model, self._data, bodies.geometry, self._places, bodies.configuration(q)
        )

    def _gap(self, pair: int) -> float:
        """Distance (m) that a pair is apart where `_place` put it, less the padding."""
        found = pinocchio.computeDistance(self.bodies.geometry, self._places, pair)
        return float(found.min_distance) - _DISTANCE_ERROR - self.bodies.padding

    def _names(self, pair: int) -> tuple[str, str]:
        objects = self.bodies.geometry.geometryObjects
        first, second = self._pairs[pair]
        return objects[first].name, objects[second].name
