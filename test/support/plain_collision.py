"""The plain way to judge a move: coal is asked about every pair at every look."""

from __future__ import annotations

import numpy as np
import pinocchio

from ft_manip_ros.core.planning.collision_model import CollisionModel


class PlainChecker:
    """Booleans of all pairs, each with the margin by which its bodies can approach."""

    def __init__(self, bodies: CollisionModel, approach: np.ndarray, halvings: int = 12) -> None:
        self.bodies, self._approach, self._halvings = bodies, approach, halvings
        self._data = bodies.model.createData()
        self._places = bodies.geometry.createData()

    def touches(self, q: np.ndarray, margins: np.ndarray | None = None) -> bool:
        bodies = self.bodies
        if margins is None:
            margins = np.full(len(bodies.geometry.collisionPairs), bodies.padding)
        requests = self._places.collisionRequests
        for request, margin in zip(requests, margins.tolist(), strict=True):
            request.security_margin = margin
        full = bodies.configuration(q)
        return bool(
            pinocchio.computeCollisions(
                bodies.model, self._data, bodies.geometry, self._places, full, True
            )
        )

    def move_touches(self, a: np.ndarray, b: np.ndarray) -> bool:
        approach = self._approach @ np.abs(b - a)
        pieces = [(0.0, 0)]
        while pieces:
            begin, level = pieces.pop()
            half = 0.5 ** (level + 1)
            q = a + (begin + half) * (b - a)
            if not self.touches(q, self.bodies.padding + half * approach):
                continue
            if level == self._halvings or self.touches(q):
                return True
            pieces += [(begin + half, level + 1), (begin, level + 1)]
        return False

    def distances(self, q: np.ndarray) -> np.ndarray:
        """Of all pairs (m), negative where they overlap."""
        bodies = self.bodies
        full = bodies.configuration(q)
        pinocchio.computeDistances(bodies.model, self._data, bodies.geometry, self._places, full)
        return np.array([result.min_distance for result in self._places.distanceResults])
