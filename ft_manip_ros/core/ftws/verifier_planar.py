"""The verifier's own closed form: polygon inequalities of planar arms without limits.

Rigid sides that can turn freely against each other close to a polygon exactly if the longest is
at most as long as all others together. The sides are the groups of links between the joints
that are not frozen, and one from the arm's base to the goal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from ft_manip_ros.core.ftws.verifier_arm import Arm, Array

PLANAR = 'planar_closed_form'

# Rounding of a distance: absolute (m), and relative to the arm and the goal's place.
_ROUNDING, _RELATIVE = 1e-12, 1e-13
# Placements further than this from rotations are none; axes that tilt by more are not parallel.
_ROTATION, _PARALLEL = 1e-9, 1e-9
# How far outside of the operating limits a frozen position may be, by rounding (rad).
_LIMIT = 1e-9


class NotPlanarError(Exception):
    """A claim that the closed form does not bear out, or that it does not apply to."""


def check_planar(arm: Arm, goal: Mapping[str, Any], target: Array, radius: float) -> str:
    """Check a goal whose proof is the closed form; ``target`` (12,) is the goal as a frame.

    Returns
    -------
    str
        What was confirmed.

    Raises
    ------
    NotPlanarError
        If the arm has limits, slides or axes that are not parallel, or the claim is wrong.
    """
    normal, error = _applies(arm, goal, target)
    if goal['verdict'] == 'member':
        return _member(arm, goal, target, radius, normal, error)
    return _lost(arm, goal, target, radius, normal, error)


def _applies(arm: Arm, goal: Mapping[str, Any], target: Array) -> tuple[Array, float]:
    """Normal of the plane, and a bound (m) of the errors of the closed form."""
    if arm.prismatic.any():
        raise NotPlanarError('the closed form is for hinges; the arm has slides')
    if not arm.wraps.all():
        name = arm.names[int(np.argmin(arm.wraps))]
        raise NotPlanarError(f'the closed form is for arms without limits; {name} has some')
    if not 0 < int(goal['order']) < arm.n:
        raise NotPlanarError(f'{goal["order"]} of {arm.n} joints cannot fail')
    rotations = np.concatenate([arm.rotations, target[3:].reshape(1, 3, 3)])
    gram = rotations.transpose(0, 2, 1) @ rotations
    skewed = np.linalg.norm(gram - np.eye(3), axis=(1, 2))
    if not skewed.max() <= _ROTATION:
        raise NotPlanarError('a placement, or the orientation of the goal, is no rotation')
    axes = arm.frames(np.zeros((1, arm.n)))[0][0]
    normal: Array = axes[0] / np.linalg.norm(axes[0])
    tilt = np.linalg.norm(np.cross(axes, normal), axis=1)
    if not tilt.max() <= _PARALLEL:
        name = arm.names[int(np.argmax(tilt))]
        raise NotPlanarError(f'the closed form is for parallel axes; that of {name} is not')
    # A turn about an axis that is e off moves what comes after it by at most 2 e of its length.
    lengths = np.linalg.norm(arm.translations, axis=1)
    after = np.cumsum(lengths[::-1])[::-1][1:] + arm.length
    bend = 2.0 * float(tilt @ after) + 4.0 * float(skewed.sum()) * (lengths.sum() + arm.length)
    scale = float(lengths.sum() + np.linalg.norm(target[:3]))
    # A tilted goal is judged as the nearest one of the plane; its length changes a little too.
    off = (2.0 if arm.oriented else 1.0) * arm.plane_distance(target)
    error = _ROUNDING + _RELATIVE * scale + bend + off
    if not np.isfinite(error) or (arm.oriented and not arm.length > 0.0):
        raise NotPlanarError('the closed form needs finite lengths, and some for orientations')
    return normal, error


def _flat(vectors: Array, normal: Array) -> Array:
    """Parts of vectors (..., 3) in the plane."""
    flat: Array = vectors - (vectors @ normal)[..., None] * normal
    return flat


def _shortest(sides: Sequence[float]) -> float:
    """Least distance between the ends of links at any angles."""
    return max(0.0, 2.0 * max(sides) - sum(sides)) if sides else 0.0


def _member(
    arm: Arm, goal: Mapping[str, Any], target: Array, radius: float, normal: Array, error: float
) -> str:
    if arm.plane_distance(target) > arm.tolerance:
        raise NotPlanarError('the goal is off the plane of the arm')
    _, origins, rotation, position = arm.frames(np.zeros((1, arm.n)))
    points = np.concatenate([origins[0], position])
    links = np.linalg.norm(_flat(np.diff(points, axis=0), normal), axis=1).tolist()
    place, per_metre = target[:3] - points[0], 1.0
    if arm.oriented:
        # The last link keeps the direction that the goal gives the tool: the goal is its start.
        place = place - target[3:].reshape(3, 3) @ rotation[0].T @ (points[-1] - points[-2])
        per_metre = float(np.hypot(1.0, links[-1] / arm.length))
    away = float(np.linalg.norm(_flat(place, normal)))
    combos = arm.combos(int(goal['order']))
    if not combos:
        raise NotPlanarError(f'no {goal["order"]} joints can fail')
    slack = np.inf
    for combo in combos:
        bridge = [away]
        sides: list[list[float]] = []
        for joint in range(arm.n):
            if joint not in combo:
                sides.append([])
            (sides[-1] if sides else bridge).append(links[joint])
        if arm.oriented:
            bridge += sides.pop()[:-1]
        shortest = [_shortest(bridge), *(_shortest(side) for side in sides)]
        total = sum(shortest)
        slack = min(slack, total - shortest[0] - sum(bridge))
        for least, side in zip(shortest[1:], sides, strict=True):
            others = total - least
            # Where the other links alone hold it to the tolerance, no goal is too near.
            if sum(side) - (others - shortest[0]) > arm.tolerance - error:
                slack = min(slack, others - sum(side))
    if not slack - radius * per_metre >= error - arm.tolerance:
        raise NotPlanarError(f'the worst frozen positions miss it by {-slack:.3g} m')
    claimed = float(goal['slack'])
    if not 0.0 <= claimed <= max(slack / per_metre, radius):
        raise NotPlanarError(f'the slack is {slack / per_metre:.9g} m, not {claimed:.9g} m')
    around = f', for the disc of {radius:g} m around it' if radius > 0.0 else ''
    return f'polygons close at any positions of {len(combos)} combinations{around}'


def _lost(
    arm: Arm, goal: Mapping[str, Any], target: Array, radius: float, normal: Array, error: float
) -> str:
    joints = [arm.index(name) for name in goal['joints']]
    angles = np.array(goal['angles'], float)
    if len(set(joints)) != int(goal['order']) or angles.shape != (len(joints),):
        raise NotPlanarError(f'{goal["joints"]} are not {goal["order"]} joints with a position')
    for joint, angle in zip(joints, angles, strict=True):
        low, high = arm.operating[:, joint]
        if not (arm.fails[joint] and low - _LIMIT <= angle <= high + _LIMIT):
            raise NotPlanarError(f'{arm.names[joint]} cannot freeze at {angle}')
    q = np.zeros((1, arm.n))
    q[0, joints] = angles
    _, origins, rotation, position = arm.frames(q)
    # What lies between two axes that still turn is rigid, whatever they do.
    turning = [i for i in range(arm.n) if i not in joints]
    ends = [*origins[0, turning], position[0]]
    goal_end, share = target[:3], 1.0
    if arm.oriented:
        last = _flat(position[0] - ends[-2], normal)
        turn = target[3:].reshape(3, 3) @ rotation[0].T
        goal_end, ends = goal_end - turn @ last, ends[:-1]
        # A tool turned by u comes nearer by at most u times what it turns on: least is this.
        share = arm.length / float(np.hypot(arm.length, np.linalg.norm(last)))
    sides = [float(np.linalg.norm(_flat(b - a, normal))) for a, b in pairwise(ends)]
    sides.append(float(np.linalg.norm(_flat(goal_end - ends[0], normal))))
    miss = share * (2.0 * max(sides) - sum(sides)) - error
    claimed = float(goal['residual'])
    if not miss > arm.tolerance + radius:
        raise NotPlanarError(f'no miss of more than {arm.tolerance + radius:.3g} m is proved')
    if not claimed <= miss:
        raise NotPlanarError(f'a miss of {miss:.9g} m is proved, not of {claimed:.9g} m')
    return f'the polygon stays open by {miss:.3g} m'
