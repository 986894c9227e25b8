"""Bodies of an arm for collision checking: those of its URDF, or capsules along its links."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import coal
import numpy as np
import pinocchio
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.pinocchio_model import model_from_chain
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


def capsule_model(
    chain: SerialChain, radius: float, obstacles: Sequence[Obstacle] = (), padding: float = 0.01
) -> CollisionModel:
    """Bodies for an arm of which only the kinematics is known: a capsule along each link.

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
    _add_obstacles(geometry, obstacles, base, fixed=[k for k, i in enumerate(links) if i == 0])
    source = f'capsules of {radius:g} m radius along the links'
    return _without_constant_pairs(chain, model, geometry, source, padding, own, described=False)


def urdf_model(
    chain: SerialChain,
    urdf: str,
    base: str | None,
    obstacles: Sequence[Obstacle] = (),
    srdf: str | None = None,
    padding: float = 0.01,
) -> CollisionModel:
    """Bodies of a URDF's collision elements; meshes become their convex hulls.

    Parameters
    ----------
    urdf
        The XML text.
    base
        Link in whose frame obstacles are given; None: the root.
    srdf
        Path of an SRDF whose disabled pairs are respected.
    padding
        Distance (m) that bodies are to keep.

    Raises
    ------
    InputError
        If a mesh is missing: `capsule_model` then still works.
    """
    model = pinocchio.buildModelFromXML(urdf)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            geometry = pinocchio.buildGeomFromUrdfString(
                model, urdf, pinocchio.GeometryType.COLLISION, _package_folders()
            )
    except (ValueError, RuntimeError) as error:
        raise InputError('URDF: collision', f'bodies cannot be read: {error}') from error
    for body in geometry.geometryObjects:
        if isinstance(body.geometry, coal.BVHModelBase):
            body.geometry.buildConvexHull(True, 'Qt')
            body.geometry = body.geometry.convex
    geometry.addAllCollisionPairs()
    moved = _moved_joints(model, chain)
    for first, second in _pairs(geometry):
        a = geometry.geometryObjects[first].parentJoint
        b = geometry.geometryObjects[second].parentJoint
        neighbours = model.parents[a] == b or model.parents[b] == a
        # As many of the arm's joints below both: they do not move against each other.
        if neighbours or moved[a] == moved[b]:
            geometry.removeCollisionPair(pinocchio.CollisionPair(first, second))
    if srdf:
        try:
            pinocchio.removeCollisionPairs(model, geometry, str(Path(srdf).expanduser()))
        except (ValueError, RuntimeError) as error:
            raise InputError('srdf', f'{srdf} cannot be read: {error}') from error
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, pinocchio.neutral(model))
    at = data.oMf[model.getFrameId(base)] if base else pinocchio.SE3.Identity()
    fixed = [k for k, b in enumerate(geometry.geometryObjects) if not moved[b.parentJoint]]
    own = len(geometry.geometryObjects)
    _add_obstacles(geometry, obstacles, at, fixed=fixed)
    source = 'collision bodies of the URDF'
    return _without_constant_pairs(chain, model, geometry, source, padding, own, described=True)


def _add_obstacles(
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


def _moved_joints(model: pinocchio.Model, chain: SerialChain) -> list[int]:
    """For each joint of the model, how many of the chain's axes move it."""
    counts, axes = [0] * model.njoints, {axis.name for axis in chain.axes}
    for j in range(1, model.njoints):
        counts[j] = counts[model.parents[j]] + (model.names[j] in axes)
    return counts


def _without_constant_pairs(
    chain: SerialChain,
    model: pinocchio.Model,
    geometry: pinocchio.GeometryModel,
    source: str,
    padding: float,
    own: int,
    *,
    described: bool,
) -> CollisionModel:
    """Drop the pairs that touch in nearly every posture: they say nothing about any."""
    found = CollisionModel(chain, model, geometry, source, padding, own, (), described)
    rng = np.random.default_rng(0)
    data, bodies = model.createData(), geometry.createData()
    for request in bodies.collisionRequests:
        request.security_margin = padding
    counts = np.zeros(len(geometry.collisionPairs), dtype=int)
    for q in rng.uniform(chain.lower, chain.upper, (_DRAWS, chain.n)):
        full = found.configuration(q)
        pinocchio.computeCollisions(model, data, geometry, bodies, full, False)
        counts += [result.isCollision() for result in bodies.collisionResults]
    names = [body.name for body in geometry.geometryObjects]
    ignored = []
    for (first, second), count in zip(_pairs(geometry), counts, strict=True):
        if count >= _ALWAYS * _DRAWS:
            ignored.append((names[first], names[second]))
            geometry.removeCollisionPair(pinocchio.CollisionPair(first, second))
    return replace(found, ignored=tuple(ignored))


def _pairs(geometry: pinocchio.GeometryModel) -> list[tuple[int, int]]:
    """Pairs as numbers: Pinocchio's own are references that shift when one is removed."""
    return [(pair.first, pair.second) for pair in geometry.collisionPairs]


def _along(direction: Array) -> Array:
    """Rotation (3, 3) whose z axis is the given unit vector."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(helper, direction)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(direction, x), direction])


def _package_folders() -> list[str]:
    """Folders that hold packages, for ``package://`` meshes."""
    folders = [p for p in os.environ.get('ROS_PACKAGE_PATH', '').split(os.pathsep) if p]
    prefixes = [p for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    folders += [str(Path(prefix) / 'share') for prefix in [*prefixes, sys.prefix]]
    folders += [str(Path(entry) / 'cmeel.prefix' / 'share') for entry in sys.path if entry]
    return [folder for folder in folders if Path(folder).is_dir()]
