"""The joint motion that a trajectory message asks for, read as a trajectory controller does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.errors import InputError


@dataclass(frozen=True, eq=False)
class JointPath:
    """Joint states at given times; between them a line, a cubic or a quintic.

    A joint_trajectory_controller interpolates linearly where only positions are given, by cubics
    where velocities are given too, and by quintics where accelerations are as well.

    Attributes
    ----------
    joint_names
        Names of the n joints, in the order of the columns.
    times : ndarray, shape (T,)
        Seconds from the start, increasing; the first one >= 0.
    positions : ndarray, shape (T, n)
        rad or m.
    velocities, accelerations : ndarray, shape (T, n), or None
        Per second and per second squared; accelerations only together with velocities.
    """

    joint_names: tuple[str, ...]
    times: Array
    positions: Array
    velocities: Array | None = None
    accelerations: Array | None = None

    def __post_init__(self) -> None:
        times = np.ascontiguousarray(self.times, dtype=float)
        if times.ndim != 1 or len(times) == 0:
            raise InputError('trajectory', 'has no points; at least one is needed')
        if not np.isfinite(times).all() or times[0] < 0.0 or np.any(np.diff(times) <= 0.0):
            raise InputError(
                'trajectory: time_from_start', 'must start at 0 or later and grow point by point'
            )
        object.__setattr__(self, 'times', times)
        shape = (len(times), len(self.joint_names))
        for key in ('positions', 'velocities', 'accelerations'):
            given = getattr(self, key)
            if given is None:
                continue
            values = np.ascontiguousarray(given, dtype=float)
            if values.shape != shape:
                raise InputError(f'trajectory: {key}', f'has shape {values.shape}; needs {shape}')
            if not np.isfinite(values).all():
                raise InputError(f'trajectory: {key}', 'contains NaN or infinity')
            object.__setattr__(self, key, values)
        if self.accelerations is not None and self.velocities is None:
            raise InputError('trajectory: accelerations', 'need velocities beside them')

    @property
    def duration(self) -> float:
        """Time of the last point (s)."""
        return float(self.times[-1])

    def ordered(self, joint_names: Sequence[str]) -> JointPath:
        """Return the same path with its columns in the order of ``joint_names``.

        Raises
        ------
        InputError
            If the two sets of names differ: a controller refuses partial goals, and unknown or
            repeated names.
        """
        if sorted(self.joint_names) != sorted(joint_names):
            raise InputError(
                'trajectory: joint_names',
                f'are {", ".join(self.joint_names) or "empty"}; needed, in any order, each once: '
                f'{", ".join(joint_names)}',
            )
        order = [self.joint_names.index(name) for name in joint_names]
        return JointPath(
            tuple(joint_names),
            self.times,
            self.positions[:, order],
            None if self.velocities is None else self.velocities[:, order],
            None if self.accelerations is None else self.accelerations[:, order],
        )

    def preceded_by(self, position: Array, velocity: Array) -> JointPath:
        """Return the path with the state (n,) at time 0 in front, unless it has a point there."""
        if self.times[0] <= 0.0:
            return self
        zeros = np.zeros_like(position)
        return JointPath(
            self.joint_names,
            np.concatenate([[0.0], self.times]),
            np.vstack([position, self.positions]),
            None if self.velocities is None else np.vstack([velocity, self.velocities]),
            None if self.accelerations is None else np.vstack([zeros, self.accelerations]),
        )

    def sample(self, time: float) -> tuple[Array, Array]:
        """Position and velocity, each (n,), ``time`` seconds from the start.

        Before the first point and after the last one the arm stands there.
        """
        k = int(np.searchsorted(self.times, time, side='right')) - 1
        if k < 0 or k >= len(self.times) - 1:
            row = 0 if k < 0 else -1
            return self.positions[row].copy(), np.zeros(len(self.joint_names))
        t = time - float(self.times[k])
        c = self._coefficients[k]
        powers = t ** np.arange(len(c))
        slopes = np.arange(1, len(c)) * powers[:-1]
        return powers @ c, slopes @ c[1:]

    @cached_property
    def _coefficients(self) -> Array:
        """Polynomials of all segments, (T - 1, degree + 1, n), lowest power first."""
        h = np.diff(self.times)[:, None]
        q, dq = self.positions[:-1], np.diff(self.positions, axis=0)
        if self.velocities is None:
            return np.stack([q, dq / h], axis=1)
        v, dv = self.velocities[:-1], np.diff(self.velocities, axis=0)
        if self.accelerations is None:
            dq = dq - v * h
            return np.stack([q, v, 3.0 * dq / h**2 - dv / h, dv / h**2 - 2.0 * dq / h**3], axis=1)
        a, da = self.accelerations[:-1], np.diff(self.accelerations, axis=0)
        dq = dq - v * h - 0.5 * a * h**2
        dv = dv - a * h
        return np.stack(
            [
                q,
                v,
                0.5 * a,
                (10.0 * dq - 4.0 * dv * h + 0.5 * da * h**2) / h**3,
                (-15.0 * dq + 7.0 * dv * h - da * h**2) / h**4,
                (6.0 * dq - 3.0 * dv * h + 0.5 * da * h**2) / h**5,
            ],
            axis=1,
        )
