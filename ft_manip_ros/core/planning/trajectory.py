"""A joint trajectory as plain arrays: what the planner makes and the gate checks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.joint_path import JointPath


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Timed joint states, unchecked but for their shapes; `check_trajectory` judges the rest.

    Attributes
    ----------
    joint_names
        All n joints of the arm, base to tip, the frozen ones included.
    times : ndarray, shape (T,)
        Seconds from the start of the trajectory, the first one 0.
    positions, velocities, accelerations : ndarray, shape (T, n)
        rad or m, per second, per second squared.
    """

    joint_names: tuple[str, ...]
    times: Array
    positions: Array
    velocities: Array
    accelerations: Array

    def __post_init__(self) -> None:
        times = np.ascontiguousarray(self.times, dtype=float)
        if times.ndim != 1 or len(times) == 0:
            raise InputError('trajectory: times', f'has shape {times.shape}; needs (T,), T > 0')
        object.__setattr__(self, 'times', times)
        shape = (len(times), len(self.joint_names))
        for key in ('positions', 'velocities', 'accelerations'):
            values = np.ascontiguousarray(getattr(self, key), dtype=float)
            if values.shape != shape:
                raise InputError(f'trajectory: {key}', f'has shape {values.shape}; needs {shape}')
            object.__setattr__(self, key, values)

    @property
    def duration(self) -> float:
        """Time of the last point (s)."""
        return float(self.times[-1])

    def path(self) -> JointPath:
        """Return the motion as a trajectory controller reads it: quintics between the points."""
        return JointPath(
            self.joint_names, self.times, self.positions, self.velocities, self.accelerations
        )
