"""Bodies for an arm of which only the kinematics is known: a capsule along each link."""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np
import pinocchio

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.pinocchio_model import model_from_chain
from ft_manip_ros.core.planning.collision_model import (
    CollisionModel,
    add_obstacles,
    without_constant_pairs,
)
from ft_manip_ros.core.planning.obstacles import Obstacle


def capsule_model(
    chain: SerialChain, radius: float, obstacles: Sequence[Obstacle] = (), padding: float = 0.01
) -> CollisionModel:
    """Return capsules along the links of an arm, and what is around it.

    Parameters
    ----------
    radius
        Of the capsules (m).
    padding
        Distance (m) that bodies are to keep.
    """
    model = model_from_chain(chain)
    geometry = pinocchio.GeometryModel()
    links = []
    for i, way in enumerate(chain.translations):
        length = float(np.linalg.norm(way))
        # The first placement is the pedestal; a shorter link hides within its neighbours.
        if length <= 2.0 * radius:
            continue
        pose = pinocchio.SE3(_along(way / length), 0.5 * way)
        parent = chain.axes[i - 1].name if i else 'base'
        body = coal.Capsule(radius, length)
        geometry.addGeometryObject(pinocchio.GeometryObject(f'link of {parent}', i, pose, body))
        links.append(i)
    for a in range(len(links)):
        # Links next to each other share a joint (with only short ones between).
        for b in range(a + 2, len(links)):
            geometry.addCollisionPair(pinocchio.CollisionPair(a, b))
    base = pinocchio.SE3.Identity()
    own = len(geometry.geometryObjects)
    add_obstacles(geometry, obstacles, base, fixed=[k for k, i in enumerate(links) if i == 0])
    source = f'capsules of {radius:g} m radius along the links'
    return without_constant_pairs(
        CollisionModel(chain, model, geometry, source, padding, own, (), base, described=False)
    )


def _along(direction: Array) -> Array:
    """Rotation (3, 3) whose z axis is the given unit vector."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(helper, direction)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(direction, x), direction])
