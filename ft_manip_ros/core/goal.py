"""What the tool has to reach: goals, and the task they make up."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.region import Region

DEFAULT_POSITION_TOLERANCE = 1e-3
DEFAULT_ORIENTATION_TOLERANCE = 1e-2
# Of a design: tables of more take minutes each, and no arm has them.
MOST_JOINTS = 32

# How far a given rotation matrix or quaternion may be from orthonormal: rounding to three
# digits in a file is accepted and cleaned, anything worse is a mistake.
_NORM_SLACK = 2e-3


@dataclass(frozen=True, eq=False)
class Goal:
    """One place the tool has to reach, in the frame of the arm's base.

    Attributes
    ----------
    position : ndarray, shape (3,)
        m.
    orientation : ndarray, shape (3, 3), or None
        Rotation of the tool frame; None where only the position matters.
    free_axis
        True: the tool may turn freely about its own z axis (needs an orientation, of which
        only the z axis then counts).
    position_tolerance, orientation_tolerance
        What counts as reached when the goal is executed, m and rad. Solvers work to their own,
        tighter tolerances.
    id
        Name of the goal in reports.
    straight_line
        True: the tool has to come here on a straight line, from the goal before or, where none
        remains before it, from where it stands.
    region
        Volume around ``position`` that a design has to reach whole, every point of it in the
        goal's orientation; None for the position alone. Read by the designer only.
    """

    position: Array
    orientation: Array | None = None
    free_axis: bool = False
    position_tolerance: float = DEFAULT_POSITION_TOLERANCE
    orientation_tolerance: float = DEFAULT_ORIENTATION_TOLERANCE
    id: str = ''
    straight_line: bool = False
    region: Region | None = None

    def __post_init__(self) -> None:
        where = f'goal {self.id!r}' if self.id else 'goal'
        position = np.array(self.position, dtype=float)
        if position.shape != (3,) or not np.isfinite(position).all():
            raise InputError(f'{where}: position', 'must be three finite numbers (m)')
        position.setflags(write=False)
        object.__setattr__(self, 'position', position)
        if self.orientation is not None:
            orientation = clean_rotation(self.orientation, f'{where}: orientation')
            orientation.setflags(write=False)
            object.__setattr__(self, 'orientation', orientation)
        elif self.free_axis:
            raise InputError(
                f'{where}: free_axis', 'needs an orientation, whose z axis is then held'
            )
        for key in ('position_tolerance', 'orientation_tolerance'):
            value = getattr(self, key)
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f'{where}: {key}', f'is {value}; must be a finite number > 0')


@dataclass(frozen=True)
class DesignSpec:
    """What the designer has to design, and within what.

    Attributes
    ----------
    dof
        Number of revolute joints.
    order
        How many joints may be frozen at once.
    lower, upper
        Limits of every joint, rad; or a tuple with one entry per joint.
    bounds
        Ranges to search in, by DH column or parameter: ``{'a': (lo, hi), 'alpha_2': (lo, hi)}``
        (m, m, rad); what is missing is left to the designer.
    fixed
        Values by DH parameter, ``{'d_1': 0.2}`` (m, m, rad).
    alpha_step
        alpha may only be a multiple of this (rad); 0 for any value.
    family
        ``'free'`` or ``'symmetric'``; see `design.space`.
    max_length
        Largest sum of link lengths (m).
    """

    dof: int
    order: int = 1
    lower: float | tuple[float, ...] = -np.pi
    upper: float | tuple[float, ...] = np.pi
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)
    alpha_step: float = 0.0
    family: str = 'free'
    max_length: float = np.inf

    def __post_init__(self) -> None:
        if self.order < 1:
            raise InputError('design: order', f'is {self.order}; must be at least 1')
        if self.dof <= self.order:
            raise InputError(
                'design: dof', f'is {self.dof}; must exceed the order of fault tolerance'
            )
        if self.dof > MOST_JOINTS:
            raise InputError('design: dof', f'is {self.dof}; must be at most {MOST_JOINTS}')
        for name, value in (('lower', self.lower), ('upper', self.upper)):
            if np.size(value) not in (1, self.dof):
                raise InputError(
                    f'design: joint limits: {name}',
                    f'has {np.size(value)} entries; {self.dof} joints need 1 or {self.dof}',
                )
        for lower, upper in self.joint_limits:
            if not (np.isfinite(lower) and np.isfinite(upper) and lower < upper):
                raise InputError(
                    'design: joint limits', f'[{lower:g}, {upper:g}] is not an interval'
                )

    @property
    def joint_limits(self) -> Array:
        """Lower and upper limit of every joint, shape (n, 2), rad."""
        return np.stack(
            [np.broadcast_to(np.ravel(v), self.dof) for v in (self.lower, self.upper)], axis=1
        )


@dataclass(frozen=True, eq=False)
class Task:
    """An ordered list of goals, and what the designer may need beside them."""

    name: str
    goals: tuple[Goal, ...]
    design: DesignSpec | None = None

    def __post_init__(self) -> None:
        if not self.goals:
            raise InputError(f'task {self.name!r}', 'has no goals; at least one is needed')
        names = [goal.id for goal in self.goals if goal.id]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(f'task {self.name!r}: goal ids', f'{twice} appear more than once')


def rotation_from_quaternion(quaternion: Sequence[float] | Array, where: str) -> Array:
    """Rotation matrix (3, 3) of a quaternion in the order [qx, qy, qz, qw].

    Raises
    ------
    InputError
        Under the name ``where``, if it is not four finite numbers of norm 1 (to rounding).
    """
    q = np.array(quaternion, dtype=float)
    if q.shape != (4,) or not np.isfinite(q).all():
        raise InputError(where, 'must be four finite numbers [qx, qy, qz, qw]')
    norm = float(np.linalg.norm(q))
    if abs(norm - 1.0) > _NORM_SLACK:
        raise InputError(where, f'has norm {norm:.4g}; a unit quaternion [qx, qy, qz, qw] needed')
    x, y, z, w = q / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_from_rotation(rotation: Array) -> Array:
    """Quaternion [qx, qy, qz, qw] (qw >= 0) of a rotation matrix (3, 3)."""
    # Of the four ways to take the square root, the one with the largest pivot is stable.
    m = rotation
    outer = np.array(
        [
            [m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]],
            [m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], m[1, 2] + m[2, 1], m[0, 2] - m[2, 0]],
            [m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], np.trace(m)],
        ]
    ) + np.eye(4)
    column = outer[:, int(np.argmax(np.diag(outer)))]
    q = column / np.linalg.norm(column)
    return -q if q[3] < 0.0 else q


def clean_rotation(matrix: Sequence[Sequence[float]] | Array, where: str) -> Array:
    """Nearest rotation matrix to one that is a rotation up to rounding, else `InputError`."""
    m = np.array(matrix, dtype=float)
    if m.shape != (3, 3) or not np.isfinite(m).all():
        raise InputError(where, 'must be a 3 x 3 rotation matrix of finite numbers')
    if np.abs(m @ m.T - np.eye(3)).max() > _NORM_SLACK or np.linalg.det(m) < 0.0:
        raise InputError(where, 'is not a rotation matrix (orthonormal, right-handed)')
    u, _, vt = np.linalg.svd(m)
    return u @ vt
