"""A joint trajectory as plain arrays, and how a trajectory controller reads between its points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.errors import InputError


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Timed joint states; between two points the controller fits a spline.

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

    def sample(self, time: float) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration, each (n,), at ``time`` s from the start.

        Quintic Hermite between points, as a joint_trajectory_controller does where positions,
        velocities and accelerations are given; before the first and after the last point the
        arm stands at that point.
        """
        k = int(np.searchsorted(self.times, time, side='right')) - 1
        if k < 0 or k >= len(self.times) - 1:
            row = 0 if k < 0 else -1
            return self.positions[row].copy(), self.velocities[row], self.accelerations[row]
        h = self.times[k + 1] - self.times[k]
        c = _quintic(
            self.positions[k : k + 2], self.velocities[k : k + 2], self.accelerations[k : k + 2], h
        )
        t = time - self.times[k]
        powers = t ** np.arange(6)
        q = powers @ c
        v = (np.arange(1, 6) * powers[:5]) @ c[1:]
        a = (np.arange(2, 6) * np.arange(1, 5) * powers[:4]) @ c[2:]
        return q, v, a


def _quintic(q: Array, v: Array, a: Array, h: float) -> Array:
    """Coefficients (6, n), lowest power first, of the quintic through two states h s apart."""
    dq = q[1] - q[0] - v[0] * h - 0.5 * a[0] * h**2
    dv = v[1] - v[0] - a[0] * h
    da = a[1] - a[0]
    return np.array(
        [
            q[0],
            v[0],
            0.5 * a[0],
            (10.0 * dq - 4.0 * dv * h + 0.5 * da * h**2) / h**3,
            (-15.0 * dq + 7.0 * dv * h - da * h**2) / h**4,
            (6.0 * dq - 3.0 * dv * h + 0.5 * da * h**2) / h**5,
        ]
    )
