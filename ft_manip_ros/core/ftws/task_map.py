"""What a goal asks of an arm: which rows of position and orientation have to vanish."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError

MODES = ('position', 'pose', 'dextrous')

# Axes this close to parallel (sine of the angle) make a chain planar.
_PARALLEL = 1e-9


class TaskArrays(NamedTuple):
    """The task as the kernels read it: m = mp + mo equations.

    The residual is ``position_rows (p - p_goal)`` above ``length * orientation_rows e`` with
    ``e = 2 vec(R R_goal^T)``, twice the vector part of the error's unit quaternion: zero only at
    the goal orientation, about the rotation vector nearby, and with second derivatives of norm
    at most 1/2 everywhere.
    """

    position_rows: Array  # (mp, 3)
    orientation_rows: Array  # (mo, 3)
    length: float  # m, how many metres a radian counts


class Plane(NamedTuple):
    """The plane of a planar arm: points x with ``normal . x = height``."""

    normal: Array  # (3,)
    height: float  # m
    basis: Array  # (2, 3)


def reach(chain: SerialChain) -> float:
    """Return an upper bound of the tool's distance from the first joint (m)."""
    total = float(np.linalg.norm(chain.translations[1:], axis=1).sum())
    for joint in chain.joints:
        if joint.prismatic:
            total += max(abs(joint.lower), abs(joint.upper))
    return total


def find_plane(chain: SerialChain) -> Plane | None:
    """Return the plane that the tool cannot leave, or None for a spatial arm.

    An arm is planar when its revolute axes are all parallel and its prismatic axes all
    perpendicular to them. Two slides alone, or a single joint, do not make a plane.
    """
    rotation = np.eye(3)
    point = np.zeros(3)
    axes = []
    for i, joint in enumerate(chain.joints):
        point = point + rotation @ chain.translations[i]
        rotation = rotation @ chain.rotations[i]
        axes.append((joint.prismatic, rotation[:, 2].copy()))
    point = point + rotation @ chain.translations[-1]
    revolute = [axis for prismatic, axis in axes if not prismatic]
    if not revolute:
        return None
    normal = revolute[0]
    for prismatic, axis in axes:
        off = abs(axis @ normal) if prismatic else np.linalg.norm(np.cross(axis, normal))
        if off > _PARALLEL:
            return None
    helper = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first)
    return Plane(normal, float(normal @ point), np.array([first, np.cross(normal, first)]))


def task_arrays(chain: SerialChain, mode: str, plane: Plane | None) -> TaskArrays:
    """Return the equations of a mode for an arm.

    Parameters
    ----------
    mode
        ``'position'``: m = 3, or 2 for a planar arm. ``'pose'`` and ``'dextrous'``: m = 6, or 3.

    Raises
    ------
    InputError
        For an unknown mode.
    """
    if mode not in MODES:
        raise InputError('mode', f'is {mode!r}; valid are {", ".join(MODES)}')
    position = np.eye(3) if plane is None else plane.basis
    if mode == 'position':
        orientation = np.zeros((0, 3))
    else:
        orientation = np.eye(3) if plane is None else plane.normal[None, :]
    # Half the reach makes turning the tool as expensive as moving it.
    length = max(0.5 * reach(chain), 1e-6)
    return TaskArrays(
        np.ascontiguousarray(position), np.ascontiguousarray(orientation), float(length)
    )
