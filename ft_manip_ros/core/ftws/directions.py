"""Can the tool's axis point anywhere at a position: directions all over the sphere, one by one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.ftws.effort import MEMBER, NON_MEMBER
from ft_manip_ros.core.ftws.engine import run_engine
from ft_manip_ros.core.ftws.problem import Problem, prepare
from ft_manip_ros.core.ftws.reach import reach_table
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.task_map import reach
from ft_manip_ros.core.goal import quaternion_from_rotation
from ft_manip_ros.core.joint import Joint

# The engine asks of failures: a joint about the tool's axis, at the tool, fails where it stands.
_STANDS = 1e-3
# How often the faces of the octahedron are quartered: 512 directions, and no other is further than
# 11 degrees from the nearest one.
_QUARTERINGS = 3
# Neighbours are not asked for one after the other, so that a lost region is found early.
_STRIDE = 37
# Branch-and-bound boxes a direction: what is not refuted soon is not refuted at all, mostly.
_BOXES = 5000


@dataclass(frozen=True)
class Directions:
    """What became of the directions asked for.

    Attributes
    ----------
    proved, asked
        How many were proved to be reached, of how many.
    lost : ndarray, shape (3,), or None
        A direction in which the position is proved to be out of reach; the search ends with it.
    residual
        The proved miss there (m).
    """

    proved: int
    asked: int
    lost: Array | None = None
    residual: float = 0.0


def prepare_directions(arm: SerialChain) -> Problem:
    """Prepare the question whether an arm without failures reaches a place, tool's axis given.

    The turn about the axis is free.
    """
    still = Joint('(stands)', operating_lower=-_STANDS, operating_upper=_STANDS)
    longer = replace(
        arm,
        joints=(*arm.joints, still),
        rotations=np.concatenate([arm.rotations, np.eye(3)[None]]),
        translations=np.concatenate([arm.translations, np.zeros((1, 3))]),
    )
    problem = prepare(longer, 'pose', 1, free_axis=True)
    combos = np.array([[arm.n]])
    table = reach_table(problem.arrays, combos, problem.ranges, 3, reach(longer))
    return replace(problem, combos=combos, table=table)


def ask_directions(problem: Problem, position: Array, settings: FtwsSettings) -> Directions:
    """Judge a position (3,), m, with the tool's axis along directions all over the sphere."""
    modest = replace(settings, intervals=False, boxes=min(settings.boxes, _BOXES))
    effort = modest.effort(True, problem.task.length)
    centres = directions()
    proved = 0
    for k in range(len(centres)):
        direction = centres[k * _STRIDE % len(centres)]
        judged = run_engine(problem, _goal_row(position, direction)[None], effort)
        if judged.verdicts[0] == NON_MEMBER:
            return Directions(proved, k + 1, direction, float(judged.residuals[0]))
        proved += int(judged.verdicts[0] == MEMBER)
    return Directions(proved, len(centres))


def directions() -> Array:
    """Unit vectors (D, 3) spread over the sphere: centres of a divided octahedron's faces."""
    faces = [np.diag(signs) for signs in product((1.0, -1.0), repeat=3)]
    for _ in range(_QUARTERINGS):
        faces = [part for face in faces for part in _quarter(face)]
    return np.array([_unit(face.sum(axis=0)) for face in faces])


def _goal_row(position: Array, direction: Array) -> Array:
    """Goal (7,) at a position with the tool's z axis along a unit vector."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = _unit(np.cross(helper, direction))
    rotation = np.column_stack([x, np.cross(direction, x), direction])
    return np.concatenate([position, np.roll(quaternion_from_rotation(rotation), 1)])


def _quarter(face: Array) -> list[Array]:
    a, b, c = face
    ab, bc, ca = _unit(a + b), _unit(b + c), _unit(c + a)
    return [np.array(part) for part in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]


def _unit(vector: Array) -> Array:
    return np.asarray(vector / np.linalg.norm(vector))
