"""A question prepared for the kernels: the arm, what counts, and which joints may fail."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays, SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.planar_form import PlanarForm, closed_form_holds, planar_form
from ft_manip_ros.core.ftws.reach import reach_table
from ft_manip_ros.core.ftws.task_map import Plane, TaskArrays, find_plane, reach, task_arrays
from ft_manip_ros.core.goal import Goal, quaternion_from_rotation, rotation_from_quaternion
from ft_manip_ros.core.joint import Joint

_SPIN = '(free tool axis)'
# Positions per frozen joint in the reach table, by order.
_SAMPLES = {1: 49, 2: 9, 3: 5}
# Operating limits of this width are none (rad): what is left out moves nothing that counts.
_ALL_ROUND = 2.0 * np.pi - 1e-13


@dataclass(frozen=True, eq=False)
class Problem:
    """The arm, the task's equations and the combinations of failed joints.

    Attributes
    ----------
    chain
        The arm; with a free tool axis it has one more joint, which turns freely and never fails.
    mode, order
        What was asked.
    plane
        The plane of a planar arm, else None.
    combos : ndarray, shape (C, k)
    ranges : ndarray, shape (2, n)
        Operating limits.
    arms : ndarray, shape (n,)
        How far the tool can be from each axis (m).
    table : ndarray, shape (T, k + 11)
        The reach table; empty where the closed form settles everything.
    """

    chain: SerialChain
    mode: str
    order: int
    arrays: ChainArrays
    task: TaskArrays
    plane: Plane | None
    combos: NDArray[np.int64]
    ranges: Array
    arms: Array
    table: Array

    @property
    def oriented(self) -> bool:
        """Whether the orientation counts."""
        return self.task.orientation_rows.shape[0] > 0

    @cached_property
    def form(self) -> PlanarForm | None:
        """The closed form of a planar arm without limits, else None."""
        if self.plane is None or not closed_form_holds(self.chain, self.plane):
            return None
        if self.oriented and 2.0 * self.task.length > reach(self.chain):
            return None  # an arm of next to no length, whose orientation counts by a least one
        return planar_form(self.chain, self.plane, self.task, self.combos)

    @property
    def closed(self) -> bool:
        """Whether the closed form settles every goal: joints also freeze all round."""
        return self.form is not None and bool((np.ptp(self.ranges, axis=0) >= _ALL_ROUND).all())


def prepare(chain: SerialChain, mode: str, order: int, free_axis: bool = False) -> Problem:
    """Prepare an arm for queries.

    Raises
    ------
    InputError
        For an unknown mode, an order outside 1..n-1, or a joint that mimics another one.
    """
    if isinstance(order, bool) or not isinstance(order, (int, np.integer)):
        raise InputError('order', f'is {order!r}; must be a whole number')
    if not 1 <= order < max(chain.n, 2):
        raise InputError('order', f'is {order}; {chain.name!r} has {chain.n} joints, so 1 to n-1')
    for axis in chain.driven:
        leader = chain.joint_names[axis.joint]
        if axis.name != leader:
            raise InputError(
                f'joint {axis.name!r}',
                f'mimics {leader!r}: verdicts are for arms whose joints each move on their own; '
                'choose base and tip so that it is not between them',
            )
    n = chain.n
    if free_axis:
        joints = (*chain.joints, Joint(_SPIN))
        chain = replace(
            chain,
            joints=joints,
            rotations=np.concatenate([chain.rotations, np.eye(3)[None]]),
            translations=np.concatenate([chain.translations, np.zeros((1, 3))]),
        )
    plane = find_plane(chain)
    lengths = np.linalg.norm(chain.translations[1:], axis=1)
    lengths = lengths + [
        max(abs(j.lower), abs(j.upper)) if j.prismatic else 0.0 for j in chain.joints
    ]
    arms = np.maximum(np.cumsum(lengths[::-1])[::-1], 1e-9)
    for i, joint in enumerate(chain.joints):
        if joint.prismatic:
            arms[i] = 1.0
    task = task_arrays(chain, mode, plane)
    if task.orientation_rows.shape[0] > 0:
        arms = np.where([j.prismatic for j in chain.joints], 1.0, np.hypot(arms, task.length))
    combos = np.array(list(combinations(range(n), order)), dtype=np.int64).reshape(-1, order)
    ranges = np.array([chain.operating_lower, chain.operating_upper])
    arrays = chain.arrays
    no_table = np.zeros((0, order + 11))
    problem = Problem(chain, mode, int(order), arrays, task, plane, combos, ranges, arms, no_table)
    if order > 1 and problem.closed:
        return problem
    samples = _SAMPLES.get(order, 3)
    return replace(problem, table=reach_table(arrays, combos, ranges, samples, reach(chain)))


def goal_rows(goals: Sequence[Goal] | Array, mode: str) -> tuple[Array, NDArray[np.bool_]]:
    """Goals as rows (N, 7) of position and quaternion (w, x, y, z), and which axes are free.

    Raises
    ------
    InputError
        Naming the row: wrong shape, NaN, or a pose without orientation.
    """
    if isinstance(goals, np.ndarray) or (len(goals) > 0 and not isinstance(goals[0], Goal)):
        return _rows_from_array(np.asarray(goals, dtype=float), mode)
    rows = np.zeros((len(goals), 7))
    free = np.zeros(len(goals), dtype=bool)
    rows[:, 3] = 1.0
    for i, goal in enumerate(goals):
        assert isinstance(goal, Goal)
        rows[i, :3] = goal.position
        if mode == 'pose':
            if goal.orientation is None:
                where = f'goal {goal.id!r}' if goal.id else f'goals[{i}]'
                raise InputError(f'{where}: orientation', "is missing; mode 'pose' needs one")
            rows[i, 3:] = np.roll(quaternion_from_rotation(goal.orientation), 1)
            free[i] = goal.free_axis
    return rows, free


def _rows_from_array(points: Array, mode: str) -> tuple[Array, NDArray[np.bool_]]:
    if points.size == 0:
        return np.zeros((0, 7)), np.zeros(0, dtype=bool)
    if points.ndim != 2 or points.shape[1] not in (3, 7):
        raise InputError('points', f'have shape {points.shape}; (N, 3) or (N, 7) is needed')
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        raise InputError(f'points[{bad[0]}]', 'contains NaN or infinity')
    rows = np.zeros((len(points), 7))
    rows[:, :3] = points[:, :3]
    rows[:, 3] = 1.0
    if mode == 'pose':
        if points.shape[1] != 7:
            raise InputError('points', "mode 'pose' needs rows of x, y, z, qx, qy, qz, qw")
        for i, point in enumerate(points):
            rotation = rotation_from_quaternion(point[3:], f'points[{i}]: orientation')
            rows[i, 3:] = np.roll(quaternion_from_rotation(rotation), 1)
    return rows, np.zeros(len(points), dtype=bool)
