"""Bodies of an arm from the collision elements of its URDF."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

import coal
import pinocchio

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.planning.collision_model import (
    CollisionModel,
    add_obstacles,
    pair_numbers,
    without_constant_pairs,
)
from ft_manip_ros.core.planning.obstacles import Obstacle


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
    for first, second in pair_numbers(geometry):
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
    add_obstacles(geometry, obstacles, at, fixed=fixed)
    source = 'collision bodies of the URDF'
    return without_constant_pairs(
        CollisionModel(chain, model, geometry, source, padding, own, (), at, described=True)
    )


def _moved_joints(model: pinocchio.Model, chain: SerialChain) -> list[int]:
    """For each joint of the model, how many of the chain's axes move it."""
    counts, axes = [0] * model.njoints, {axis.name for axis in chain.axes}
    for j in range(1, model.njoints):
        counts[j] = counts[model.parents[j]] + (model.names[j] in axes)
    return counts


def _package_folders() -> list[str]:
    """Folders that hold packages, for ``package://`` meshes."""
    folders = [p for p in os.environ.get('ROS_PACKAGE_PATH', '').split(os.pathsep) if p]
    prefixes = [p for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    folders += [str(Path(prefix) / 'share') for prefix in [*prefixes, sys.prefix]]
    folders += [str(Path(entry) / 'cmeel.prefix' / 'share') for entry in sys.path if entry]
    return [folder for folder in folders if Path(folder).is_dir()]
