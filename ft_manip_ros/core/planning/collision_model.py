"""What a collision model holds: bodies on a Pinocchio model, and the pairs that matter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.planning.obstacles import Obstacle

# Postures drawn to find the pairs of bodies that always touch, as neighbouring links may.
_DRAWS = 300
_ALWAYS = 0.95


@dataclass(frozen=True, eq=False)
class CollisionModel:
    """Bodies on a Pinocchio model, with the pairs that matter.

    Attributes
    ----------
    chain
        The arm that is moved.
    model, geometry
        Pinocchio's.
    source
        Where the bodies come from, for a person.
    padding
        Distance (m) that bodies are to keep.
    own
        How many of the geometry's objects are the robot's; the others are obstacles.
    ignored
        Names of pairs that touch in (nearly) every posture and are not checked.
    base
        Where the arm's base frame stands in the model.
    described
        Whether the model is that of the arm's URDF, not made from the chain.
    """

    chain: SerialChain
    model: pinocchio.Model
    geometry: pinocchio.GeometryModel
    source: str
    padding: float
    own: int
    ignored: tuple[tuple[str, str], ...]
    base: pinocchio.SE3
    described: bool = False

    @cached_property
    def _places(self) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, Array]:
        """Where each axis of the arm is in a configuration, which have two coordinates there.

        Last, what the model adds to their positions: a URDF's mimic joints have an offset.
        """
        joints = [self.model.joints[self.model.getJointId(a.name)] for a in self.chain.axes]
        offsets = [axis.offset for axis in self.chain.axes]
        return (
            np.array([joint.idx_q for joint in joints], dtype=np.intp),
            np.flatnonzero([joint.nq == 2 for joint in joints]),
            pinocchio.neutral(self.model),
            np.array(offsets) * self.described,
        )

    def configuration(self, q: Array) -> Array:
        """Return a posture of the arm, (n,), as Pinocchio's, (nq,); other joints at neutral.

        Joints are mapped by name: a continuous one has two coordinates there.
        """
        places, turning, neutral, offsets = self._places
        full = neutral.copy()
        at = self.chain.axis_positions(q) + offsets
        full[places] = at
        if len(turning):
            full[places[turning]] = np.cos(at[turning])
            full[places[turning] + 1] = np.sin(at[turning])
        return full


def add_obstacles(
    geometry: pinocchio.GeometryModel,
    obstacles: Sequence[Obstacle],
    base: pinocchio.SE3,
    *,
    fixed: list[int],
) -> None:
    """Add obstacles and their pairs with every body that moves."""
    own = len(geometry.geometryObjects)
    for obstacle in obstacles:
        pose = base * pinocchio.SE3(obstacle.rotation, obstacle.position)
        index = geometry.addGeometryObject(
            pinocchio.GeometryObject(obstacle.name, 0, pose, obstacle.geometry())
        )
        for body in range(own):
            if body not in fixed:
                geometry.addCollisionPair(pinocchio.CollisionPair(body, index))


def without_constant_pairs(found: CollisionModel) -> CollisionModel:
    """Drop the pairs that touch in nearly every posture: they say nothing about any."""
    chain, model, geometry = found.chain, found.model, found.geometry
    rng = np.random.default_rng(0)
    data, bodies = model.createData(), geometry.createData()
    for request in bodies.collisionRequests:
        request.security_margin = found.padding
    counts = np.zeros(len(geometry.collisionPairs), dtype=int)
    for q in rng.uniform(chain.lower, chain.upper, (_DRAWS, chain.n)):
        full = found.configuration(q)
        pinocchio.computeCollisions(model, data, geometry, bodies, full, False)
        counts += [result.isCollision() for result in bodies.collisionResults]
    names = [body.name for body in geometry.geometryObjects]
    ignored = []
    for (first, second), count in zip(pair_numbers(geometry), counts, strict=True):
        if count >= _ALWAYS * _DRAWS:
            ignored.append((names[first], names[second]))
            geometry.removeCollisionPair(pinocchio.CollisionPair(first, second))
    return replace(found, ignored=tuple(ignored))


def pair_numbers(geometry: pinocchio.GeometryModel) -> list[tuple[int, int]]:
    """Pairs as numbers: Pinocchio's own are references that shift when one is removed."""
    return [(pair.first, pair.second) for pair in geometry.collisionPairs]
