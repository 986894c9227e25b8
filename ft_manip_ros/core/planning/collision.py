"""Collision along whole motions, by bisection: nothing is passed unseen between two looks."""

from __future__ import annotations

import numpy as np
import pinocchio

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.planning.collision_model import CollisionModel

# Halvings of a move after which what is still too near to tell apart counts as touching.
_HALVINGS = 12


class CollisionChecker:
    """Judges postures and straight joint-space moves of one arm among its obstacles.

    Not to be used from two threads at once.

    Parameters
    ----------
    bodies
        The arm and what is around it.
    """

    def __init__(self, bodies: CollisionModel) -> None:
        self.bodies = bodies
        self._data = bodies.model.createData()
        self._near = bodies.geometry.createData()
        for request in self._near.collisionRequests:
            request.security_margin = bodies.padding
        self._levels = [bodies.geometry.createData() for _ in range(_HALVINGS + 1)]
        self._allowed: list[int] = []
        self._approach = _approaches(bodies)

    def allow_at(self, q: Array) -> tuple[tuple[str, str], ...]:
        """Stop checking the arm's own bodies that touch at a posture against each other.

        The arm stands there, so such a pair touches in its model only: through padding, or hulls
        that are wider than the bodies. Obstacles go on being checked. Forgets what an earlier
        call allowed. Returns the names of the pairs.
        """
        geometry = self.bodies.geometry
        pairs = [(pair.first, pair.second) for pair in geometry.collisionPairs]
        datas = [self._near, *self._levels]
        for k in self._allowed:
            for data in datas:
                data.activateCollisionPair(k)
        full = self.bodies.configuration(q)
        pinocchio.computeCollisions(
            self.bodies.model, self._data, geometry, self._near, full, False
        )
        results = self._near.collisionResults
        own = self.bodies.own
        self._allowed = [
            k
            for k, (first, second) in enumerate(pairs)
            if first < own and second < own and results[k].isCollision()
        ]
        for k in self._allowed:
            for data in datas:
                data.deactivateCollisionPair(k)
        names = [body.name for body in geometry.geometryObjects]
        return tuple((names[pairs[k][0]], names[pairs[k][1]]) for k in self._allowed)

    def touches(self, q: Array) -> bool:
        """Tell whether bodies come nearer than the padding at a posture, shape (n,)."""
        return self._collide(self._near, q)

    def touching(self, q: Array) -> tuple[str, str] | None:
        """Return the names of two bodies nearer than the padding at a posture, or None."""
        geometry = self.bodies.geometry
        full = self.bodies.configuration(q)
        pinocchio.computeCollisions(
            self.bodies.model, self._data, geometry, self._near, full, False
        )
        results = self._near.collisionResults
        for k, pair in enumerate(geometry.collisionPairs):
            # The results of pairs that are let go are old ones.
            if k not in self._allowed and results[k].isCollision():
                objects = geometry.geometryObjects
                return objects[pair.first].name, objects[pair.second].name
        return None

    def move_touches(self, a: Array, b: Array) -> bool:
        """Tell whether anything touches on the straight joint-space move from a to b, (n,).

        Around the middle of a piece of the move, no two bodies approach each other by more than
        the joints between them can move the outer one in half the piece. Where all are farther
        apart than that (and the padding), the whole piece is free; else it is halved.
        """
        if self.touches(a) or self.touches(b):
            return True
        # Approach of each pair over the whole move.
        approach = self._approach @ np.abs(b - a)
        margins_set = -1
        pieces = [(0.0, 0)]
        while pieces:
            begin, level = pieces.pop()
            if level > margins_set:
                half = 0.5 ** (level + 1)
                margins = self.bodies.padding + half * approach
                requests = self._levels[level].collisionRequests
                for request, margin in zip(requests, margins.tolist(), strict=True):
                    request.security_margin = margin
                margins_set = level
            middle = begin + 0.5 ** (level + 1)
            q = a + middle * (b - a)
            if not self._collide(self._levels[level], q):
                continue
            if level == _HALVINGS or self.touches(q):
                return True
            pieces += [(middle, level + 1), (begin, level + 1)]
        return False

    def first_touch(self, times: Array, positions: Array) -> float | None:
        """Time (s) from which a motion touches something, or None.

        Between two of its samples, (T,) and (T, n), it is taken as straight in joint space.
        """
        for time, a, b in zip(times, positions, positions[1:], strict=False):
            if np.any(a != b) and self.move_touches(a, b):
                return float(time)
        return None

    def _collide(self, data: pinocchio.GeometryData, q: Array) -> bool:
        full = self.bodies.configuration(q)
        return bool(
            pinocchio.computeCollisions(
                self.bodies.model, self._data, self.bodies.geometry, data, full, True
            )
        )


def _approaches(bodies: CollisionModel) -> Array:
    """How far two bodies can approach per joint motion, shape (pairs, n), m per rad or 1.

    A joint that carries just one of a pair moves its points by no more than their distance from
    the joint, bounded by the placements in between and the body's own size.
    """
    model, geometry, chain = bodies.model, bodies.geometry, bodies.chain
    axes = chain.uncoupled.joints
    columns = {model.getJointId(axis.name): i for i, axis in enumerate(axes)}
    own = np.zeros((len(geometry.geometryObjects), len(axes)))
    for k, body in enumerate(geometry.geometryObjects):
        body.geometry.computeLocalAABB()
        centre = body.placement.act(body.geometry.aabb_center)
        reach = float(np.linalg.norm(centre)) + float(body.geometry.aabb_radius)
        joint = body.parentJoint
        while joint > 0:
            i = columns.get(joint)
            sliding = i is not None and axes[i].prismatic
            if i is not None:
                own[k, i] = 1.0 if sliding else reach
            reach += float(np.linalg.norm(model.jointPlacements[joint].translation))
            if i is not None and sliding:
                reach += max(abs(axes[i].lower), abs(axes[i].upper)) + abs(chain.axes[i].offset)
            joint = model.parents[joint]
    rows = []
    for pair in geometry.collisionPairs:
        a, b = own[pair.first], own[pair.second]
        # Joints that carry both do not move one against the other.
        rows.append(np.where((a > 0.0) & (b > 0.0), 0.0, a + b))
    motion = np.zeros((len(axes), chain.n))
    for i, axis in enumerate(chain.axes):
        motion[i, axis.joint] = abs(axis.ratio)
    return np.array(rows).reshape(-1, len(axes)) @ motion
