"""Commanded motion: trajectories as a joint_trajectory_controller runs them, and references."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.errors import InputError

Array = NDArray[np.float64]
_DEGREE = 5
_INSTANT = 1e-6  # s, a step
_LEAST_GROWTH = 0.5e-9  # s between points: messages count whole nanoseconds

# Time from start (s), positions, velocities, accelerations; the latter two may be empty.
TrajectoryPoint = tuple[float, Sequence[float], Sequence[float], Sequence[float]]


@dataclass(frozen=True, eq=False)
class Spline:
    """Piecewise polynomials of some joints over time.

    Attributes
    ----------
    joints : ndarray of int, shape (m,)
        Places of the commanded joints in the arm.
    knots : ndarray, shape (p+1,)
        Times (s) at which the p pieces begin and the last one ends, strictly growing.
    coefficients : ndarray, shape (p, 6, m)
        Powers of (t - knot), lowest first.
    """

    joints: NDArray[np.int64]
    knots: Array
    coefficients: Array


@numba.njit(cache=True, nogil=True)
def _evaluate(
    joints: NDArray[np.int64], knots: Array, coefficients: Array, t: float, out: Array
) -> None:
    last = knots.shape[0] - 1
    if t <= knots[0]:
        piece, s = 0, 0.0
    elif t >= knots[last]:
        piece, s = last - 1, knots[last] - knots[last - 1]
    else:
        piece = int(np.searchsorted(knots, t, side='right')) - 1
        s = t - knots[piece]
    for i in range(joints.shape[0]):
        value = 0.0
        for power in range(_DEGREE, -1, -1):
            value = value * s + coefficients[piece, power, i]
        out[joints[i]] = value


@numba.njit(cache=True, nogil=True)
def _evaluate_from(
    start: float,
    joints: NDArray[np.int64],
    knots: Array,
    coefficients: Array,
    times: Array,
    out: Array,
) -> None:
    for k in range(times.shape[0]):
        if times[k] >= start:
            _evaluate(joints, knots, coefficients, times[k], out[k])


def hermite(times: Array, positions: Array, velocities: Array, accelerations: Array) -> Array:
    """Coefficients, shape (p, 6, m), through the points, as the controller interpolates.

    Linear where velocities are NaN at either end of a piece, cubic with velocities, quintic with
    accelerations too.

    Parameters
    ----------
    times : ndarray, shape (p+1,)
    positions, velocities, accelerations : ndarray, shape (p+1, m)
        NaN marks derivatives that were not given.
    """
    h = np.diff(times)[:, None]
    p0, p1 = positions[:-1], positions[1:]
    v0, v1 = velocities[:-1], velocities[1:]
    a0, a1 = accelerations[:-1], accelerations[1:]
    out = np.zeros((len(h), _DEGREE + 1, positions.shape[1]))
    rise = p1 - p0
    linear = np.isnan(v0 + v1)
    quintic = ~linear & ~np.isnan(a0 + a1)
    out[:, 0] = p0
    out[:, 1] = np.where(linear, rise / h, v0)
    cubic_2 = (3 * rise / h - 2 * v0 - v1) / h
    cubic_3 = (v0 + v1 - 2 * rise / h) / h**2
    quintic_3 = (20 * rise - (8 * v1 + 12 * v0) * h - (3 * a0 - a1) * h**2) / (2 * h**3)
    quintic_4 = (-30 * rise + (14 * v1 + 16 * v0) * h + (3 * a0 - 2 * a1) * h**2) / (2 * h**4)
    quintic_5 = (12 * rise - 6 * (v1 + v0) * h + (a1 - a0) * h**2) / (2 * h**5)
    out[:, 2] = np.where(linear, 0.0, np.where(quintic, a0 / 2, cubic_2))
    out[:, 3] = np.where(linear, 0.0, np.where(quintic, quintic_3, cubic_3))
    out[:, 4] = np.where(quintic, quintic_4, 0.0)
    out[:, 5] = np.where(quintic, quintic_5, 0.0)
    return out


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
                _evaluate(spline.joints, spline.knots, spline.coefficients, t, out)
        return out

    def over(self, times: Array) -> Array:
        """Commanded positions at growing ``times`` (s), shape (K, n): as `at` one by one."""
        if self._pending and self._pending[0][0] <= times[-1]:
            return np.array([self.at(t).copy() for t in times.tolist()])
        out = np.tile(self.values, (len(times), 1))
        for start, spline in self._splines:
            _evaluate_from(start, spline.joints, spline.knots, spline.coefficients, times, out)
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
