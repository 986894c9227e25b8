"""Capsules around the bodies of a collision model, tight enough to settle most questions."""

from __future__ import annotations

from typing import NamedTuple

import coal
import numpy as np
import pinocchio
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.planning.collision_model import CollisionModel

# Steps towards the middle of the smallest circle around a body (Badoiu & Clarkson).
_CENTRINGS = 200
# How much wider a fitted capsule is made for rounding (m).
_ROUNDING = 1e-9


class BoundingBodies(NamedTuple):
    """B bodies on the N axes of an arm, and P pairs of them, as the kernels read them.

    Every body lies within its capsule, a segment with a radius, and within its hull, that of
    some points and again a radius. What stands still may be a box.
    """

    rotations: NDArray[np.float64]  # (N+1, 3, 3), placements of the axes
    translations: NDArray[np.float64]  # (N+1, 3), m
    prismatic: NDArray[np.bool_]  # (N,)
    axis: NDArray[np.int64]  # (B,), last axis that moves the body, -1 for none
    ends: NDArray[np.float64]  # (B, 2, 3), of the segment, in the moved frame of that axis, m
    radius: NDArray[np.float64]  # (B,), m
    exact: NDArray[np.bool_]  # (B,), the capsule is the body
    points: NDArray[np.float64]  # (K, 3), of the hulls, one after the other, in the same frames
    begin: NDArray[np.int64]  # (B+1,), first point of each hull, and K
    round: NDArray[np.float64]  # (B,), radius around the hull's points, m
    whole: NDArray[np.bool_]  # (B,), the hull is the body
    boxed: NDArray[np.bool_]  # (B,), the body stands still and is this box:
    box_rotation: NDArray[np.float64]  # (B, 3, 3), in the base frame
    box_centre: NDArray[np.float64]  # (B, 3), m
    box_half: NDArray[np.float64]  # (B, 3), half of its sides, m
    first: NDArray[np.int64]  # (P,)
    second: NDArray[np.int64]  # (P,)


def bounding_bodies(bodies: CollisionModel) -> BoundingBodies:
    """Fit a capsule to each body, and find the axis that it moves with."""
    chain, geometry = bodies.chain.uncoupled, bodies.geometry
    axis = np.array([_last_axis(bodies, body.parentJoint) for body in geometry.geometryObjects])
    poses = _poses(bodies, axis)
    capsules = [bounding_capsule(body.geometry) for body in geometry.geometryObjects]
    hulls = [bounding_hull(body.geometry) for body in geometry.geometryObjects]
    placed = [pose.rotation for pose in poses], [pose.translation for pose in poses]
    ends = [c.points @ r.T + t for c, r, t in zip(capsules, *placed, strict=True)]
    points = [h.points @ r.T + t for h, r, t in zip(hulls, *placed, strict=True)]
    boxes = [isinstance(body.geometry, coal.Box) for body in geometry.geometryObjects]
    pairs = [(pair.first, pair.second) for pair in geometry.collisionPairs]
    first, second = np.array(pairs, dtype=np.int64).reshape(-1, 2).T.copy()
    return BoundingBodies(
        chain.rotations.copy(),
        chain.translations.copy(),
        chain.arrays.prismatic,
        axis.astype(np.int64),
        np.array(ends).reshape(-1, 2, 3),
        np.array([capsule.radius for capsule in capsules]),
        np.array([capsule.exact for capsule in capsules], dtype=np.bool_),
        np.concatenate([np.empty((0, 3)), *points]),
        np.cumsum([0, *map(len, points)]),
        np.array([hull.radius for hull in hulls]),
        np.array([hull.exact for hull in hulls], dtype=np.bool_),
        (axis < 0) & np.array(boxes, dtype=np.bool_),
        np.array(placed[0]).reshape(-1, 3, 3),
        np.array(placed[1]).reshape(-1, 3),
        np.array([np.abs(hull.points).max(axis=0) for hull in hulls]).reshape(-1, 3),
        first,
        second,
    )


class Rounded(NamedTuple):
    """What lies within a radius (m) of the hull of some points, (K, 3), m."""

    points: Array
    radius: float
    exact: bool  # the shape is no smaller


def bounding_capsule(shape: coal.CollisionGeometry) -> Rounded:
    """Return a capsule around a shape, the ends of its segment as points."""
    hull = bounding_hull(shape)
    if len(hull.points) <= 2:
        return Rounded(hull.points[[0, -1]], hull.radius, hull.exact)
    return Rounded(*_around(hull.points), exact=False)


def bounding_hull(shape: coal.CollisionGeometry) -> Rounded:
    """Return a hull around a shape: exactly that of a polytope, a box, a sphere or a capsule."""
    if isinstance(shape, coal.Sphere):
        return Rounded(np.zeros((1, 3)), shape.radius, exact=True)
    if isinstance(shape, (coal.Capsule, coal.Cylinder)):
        ends = np.array([[0.0, 0.0, -shape.halfLength], [0.0, 0.0, shape.halfLength]])
        return Rounded(ends, shape.radius, exact=isinstance(shape, coal.Capsule))
    if isinstance(shape, coal.ConvexBase):
        return Rounded(np.array(shape.points()), 0.0, exact=True)
    shape.computeLocalAABB()
    box = np.array([shape.aabb_local.min_, shape.aabb_local.max_])
    corners = np.array(np.meshgrid(*box.T)).reshape(3, -1).T
    return Rounded(corners, 0.0, exact=isinstance(shape, coal.Box))


def _around(points: Array) -> tuple[Array, float]:
    """Capsule of small volume around points (K, 3): along one of their principal directions."""
    middle = points.mean(axis=0)
    _, _, directions = np.linalg.svd(points - middle)
    best: tuple[float, Array, float] | None = None
    for axis in directions:
        along = points @ axis
        across = points - along[:, None] * axis
        centre = across.mean(axis=0)
        for step in range(1, _CENTRINGS + 1):
            farthest = across[np.argmax(np.linalg.norm(across - centre, axis=1))]
            centre = centre + (farthest - centre) / (step + 1)
        off = np.linalg.norm(across - centre, axis=1)
        radius = float(off.max()) + _ROUNDING
        # A point is inside if the segment comes within this much of it along the axis.
        slack = np.sqrt(radius**2 - off**2)
        low, high = float((along + slack).min()), float((along - slack).max())
        if low > high:
            low = high = 0.5 * (low + high)
            radius = float(np.hypot(off, along - low).max()) + _ROUNDING
        volume = np.pi * radius**2 * (high - low + 4.0 / 3.0 * radius)
        if best is None or volume < best[0]:
            best = volume, centre + np.outer([low, high], axis), radius
    assert best is not None
    return best[1], best[2]


def _last_axis(bodies: CollisionModel, joint: int) -> int:
    """Place of the last of the arm's axes on the way from the root to a joint, or -1."""
    names = [axis.name for axis in bodies.chain.axes]
    while joint > 0:
        if bodies.model.names[joint] in names:
            return names.index(bodies.model.names[joint])
        joint = bodies.model.parents[joint]
    return -1


def _poses(bodies: CollisionModel, axis: NDArray[np.intp]) -> list[pinocchio.SE3]:
    """Where each body sits in the moved frame of its axis, from one posture of the model."""
    chain, model, geometry = bodies.chain, bodies.model, bodies.geometry
    q = 0.5 * (chain.lower + chain.upper)
    data, places = model.createData(), geometry.createData()
    pinocchio.updateGeometryPlacements(model, data, geometry, places, bodies.configuration(q))
    frame = pinocchio.SE3.Identity()
    frames = [frame]
    for k, s in enumerate(chain.axis_positions(q)):
        frame = frame * pinocchio.SE3(chain.rotations[k].copy(), chain.translations[k].copy())
        if chain.axes[k].prismatic:
            frame = frame * pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, s]))
        else:
            frame = frame * pinocchio.SE3(pinocchio.utils.rotate('z', s), np.zeros(3))
        frames.append(frame)
    return [
        (bodies.base * frames[i + 1]).actInv(place)
        for i, place in zip(axis, places.oMg, strict=True)
    ]
