"""Commanded motion: trajectories as a joint_trajectory_controller runs them, and references."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.detection.spline import Spline, evaluate, evaluate_from, hermite
from ft_manip_ros.core.errors import InputError

Array = NDArray[np.float64]
_INSTANT = 1e-6  # s, a step
_LEAST_GROWTH = 0.5e-9  # s between points: messages count whole nanoseconds

# Time from start (s), positions, velocities, accelerations; the latter two may be empty.
TrajectoryPoint = tuple[float, Sequence[float], Sequence[float], Sequence[float]]


class CommandBook:
    """The commanded position of every joint at any recent time.

    A new trajectory takes over its joints from its start time on, beginning where the command
    stands then; after its last point the joint is held there. References take over at once.

    Parameters
    ----------
    n
        Number of joints.
    """

    def __init__(self, n: int) -> None:
        self.values: Array = np.full(n, np.nan)
        self._scratch: Array = np.full(n, np.nan)
        self._splines: list[tuple[float, Spline]] = []
        self._pending: list[tuple[float, NDArray[np.int64], Array]] = []

    def clear(self) -> None:
        """Forget every command."""
        self.values[:] = np.nan
        self._splines.clear()
        self._pending.clear()

    def at(self, t: float) -> Array:
        """Commanded positions at ``t`` (s), shape (n,), NaN where unknown; valid until next call.

        Times must not go back by more than the messages' own disorder.
        """
        while self._pending and self._pending[0][0] <= t:
            _, joints, positions = self._pending.pop(0)
            self.values[joints] = positions
        out = self._scratch
        out[:] = self.values
        for start, spline in self._splines:
            if t >= start:
                evaluate(spline.joints, spline.knots, spline.coefficients, t, out)
        return out

    def over(self, times: Array) -> Array:
        """Commanded positions at growing ``times`` (s), shape (K, n): as `at` one by one."""
        if self._pending and self._pending[0][0] <= times[-1]:
            return np.array([self.at(t).copy() for t in times.tolist()])
        out = np.tile(self.values, (len(times), 1))
        for start, spline in self._splines:
            evaluate_from(start, spline.joints, spline.knots, spline.coefficients, times, out)
        return out

    def reference(self, stamp: float, joints: NDArray[np.int64], positions: Array) -> None:
        """Take set points that hold from ``stamp`` (s) until the next ones."""
        if self._splines:
            self._end_splines(joints, stamp)
        self._pending.append((stamp, joints, positions))
        self._pending.sort(key=lambda item: item[0])

    def trajectory(
        self,
        start: float,
        joints: NDArray[np.int64],
        times: Array,
        positions: Array,
        velocities: Array,
        accelerations: Array,
        measured: Array,
    ) -> None:
        """Take a trajectory that starts at ``start`` (s); no points at all: hold where it stands.

        Parameters
        ----------
        joints : ndarray of int, shape (m,)
        times : ndarray, shape (p,)
            Time from start of each point, strictly growing, not negative.
        positions, velocities, accelerations : ndarray, shape (p, m)
            NaN marks derivatives that were not given.
        measured : ndarray, shape (n,)
            Where the joints stand, for those without any command so far.
        """
        begin = self.at(start)[joints].copy()
        begin = np.where(np.isnan(begin), measured[joints], begin)
        if len(times) == 0:
            times, positions = np.zeros(1), begin[None, :]
            velocities, accelerations = np.zeros((2, 1, len(joints)))
        if times[0] > 0.0:
            begin = np.where(np.isnan(begin), positions[0], begin)
            rest = np.zeros((1, len(joints)))
            times = np.concatenate(([0.0], times))
            positions = np.vstack((begin, positions))
            velocities = np.vstack((rest, velocities))
            accelerations = np.vstack((rest, accelerations))
        elif len(times) == 1:
            times = np.array([0.0, _INSTANT])
            positions = np.vstack((positions, positions))
            velocities, accelerations = np.zeros((2, *positions.shape))
        coefficients = hermite(times, positions, velocities, accelerations)
        spline = Spline(joints, times + start, np.ascontiguousarray(coefficients))
        self._prune(start, joints)
        self._splines.append((start, spline))

    def ends(self) -> float:
        """Time (s) at which the last known trajectory ends; -inf without any."""
        return max((spline.knots[-1] for _, spline in self._splines), default=-np.inf)

    def _end_splines(self, joints: NDArray[np.int64], stamp: float) -> None:
        """Let references take ``joints`` over from the trajectories."""
        taken = set(joints.tolist())
        kept = []
        for start, spline in self._splines:
            mine = np.array([int(j) in taken for j in spline.joints])
            if not mine.any():
                kept.append((start, spline))
                continue
            held = self.at(stamp)
            self.values[spline.joints[mine]] = held[spline.joints[mine]]
            if not mine.all():
                coefficients = np.ascontiguousarray(spline.coefficients[:, :, ~mine])
                kept.append((start, Spline(spline.joints[~mine], spline.knots, coefficients)))
        self._splines = kept

    def _prune(self, start: float, joints: NDArray[np.int64]) -> None:
        """Drop splines that nothing can ask for once a newer one begins at ``start``."""
        taken = set(joints.tolist())
        for begun, spline in list(self._splines):
            if begun >= start and taken.issuperset(spline.joints.tolist()):
                self._splines.remove((begun, spline))
        # The one before last still answers for samples that arrive late.
        same = [item for item in self._splines if taken.issuperset(item[1].joints.tolist())]
        for item in same[:-1]:
            self._splines.remove(item)


def point_table(
    field_name: str,
    points: Sequence[TrajectoryPoint],
    m: int,
) -> tuple[Array, Array, Array, Array]:
    """Times (p,) and positions, velocities, accelerations (p, m) of trajectory points.

    Raises
    ------
    InputError
        For wrong lengths, numbers that are not finite, or times that do not grow by a nanosecond.
    """
    times = np.array([point[0] for point in points], dtype=float)
    tables = []
    for column, key in ((1, 'positions'), (2, 'velocities'), (3, 'accelerations')):
        rows = []
        for k, point in enumerate(points):
            row = np.asarray(point[column], dtype=float)
            if row.size == 0 and column > 1:
                row = np.full(m, np.nan)
            elif row.shape != (m,):
                raise InputError(
                    f'{field_name}.points[{k}].{key}',
                    f'has {row.size} values; {m} joints are named',
                )
            elif not np.isfinite(row).all():
                raise InputError(f'{field_name}.points[{k}].{key}', 'contains NaN or infinity')
            rows.append(row)
        tables.append(np.array(rows, dtype=float).reshape(len(points), m))
    # A start that is all but zero would make a piece of no length before it.
    gaps = np.diff(np.concatenate(([0.0], times)) if times.size and times[0] > 0.0 else times)
    if not np.isfinite(times).all() or (times < 0.0).any() or (gaps < _LEAST_GROWTH).any():
        raise InputError(
            f'{field_name}.points',
            'have times from start that are negative or do not grow by a nanosecond each',
        )
    return times, tables[0], tables[1], tables[2]
