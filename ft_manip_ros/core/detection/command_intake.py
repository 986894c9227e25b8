"""Commanded motion by joint names, checked before anything of it is believed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.detection.commands import CommandBook, TrajectoryPoint, point_table
from ft_manip_ros.core.errors import InputError

Array = NDArray[np.float64]


class CommandIntake:
    """Turns named commands into those of a `CommandBook`; unknown joints are left out.

    Parameters
    ----------
    names
        The n watched joints.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._place = {name: j for j, name in enumerate(self._names)}
        self._book = CommandBook(len(self._names))

    def at(self, t: float) -> Array:
        """Commanded positions at ``t`` (s), shape (n,); NaN where unknown."""
        return self._book.at(t)

    def over(self, times: Array) -> Array:
        """Commanded positions at growing ``times`` (s), shape (K, n); NaN where unknown."""
        return self._book.over(times)

    def clear(self) -> None:
        """Forget every command."""
        self._book.clear()

    def reference(self, t: float, positions: Mapping[str, float]) -> None:
        """Take set points (rad or m) that hold from ``t`` (s) on.

        Raises
        ------
        InputError
            For a position that is not finite; the whole message is then ignored.
        """
        mine = {self._place[k]: float(v) for k, v in positions.items() if k in self._place}
        for j, value in mine.items():
            if not math.isfinite(value):
                raise InputError(f'reference of {self._names[j]!r}', f'is {value}; must be finite')
        if mine:
            self._book.reference(t, np.array(list(mine)), np.array(list(mine.values())))

    def trajectory(
        self, t: float, names: Sequence[str], points: Sequence[TrajectoryPoint], measured: Array
    ) -> None:
        """Take a trajectory of the joints ``names`` that starts at ``t`` (s); no points: hold.

        Parameters
        ----------
        measured : ndarray, shape (n,)
            Where the joints stand, for those without any command so far.

        Raises
        ------
        InputError
            For wrong lengths, values that are not finite, or times that do not grow.
        """
        if len(set(names)) != len(names):
            raise InputError('trajectory.joint_names', f'{list(names)} name a joint twice')
        times, positions, velocities, accelerations = point_table('trajectory', points, len(names))
        columns = [k for k, name in enumerate(names) if name in self._place]
        joints = np.array([self._place[names[k]] for k in columns], dtype=np.int64)
        if not names and not points:
            joints, columns = np.arange(len(self._names)), []
        if not len(joints):
            raise InputError(
                'trajectory.joint_names',
                f'{list(names)} has no watched joint; those are {", ".join(self._names)}',
            )
        self._book.trajectory(
            t,
            joints,
            times,
            positions[:, columns],
            velocities[:, columns],
            accelerations[:, columns],
            measured,
        )
