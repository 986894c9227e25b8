"""Bounded inverse kinematics of a chain or a ROD, for one goal or many."""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.ik_kernels import solve_rows
from ft_manip_ros.core.ik_settings import IkSettings, ik_control, ik_mode
from ft_manip_ros.core.ik_types import CONVERGED, LOCAL_MINIMUM

_NO_ROTATION = np.eye(3)
# Problems a thread takes at a time: enough to outweigh the hand-over.
_CHUNK = 256


@dataclass(frozen=True, eq=False)
class IkResult:
    """Where a solve ended.

    Attributes
    ----------
    q : ndarray, shape (n,)
        The posture, within the physical limits (rad or m), of the least error found.
    residual
        Weighted error, sqrt(position_error^2 + (weight orientation_error)^2), m.
    position_error, orientation_error
        m and rad; the orientation error is 0 where the goal asks for none.
    converged
        Whether both errors are within tolerance.
    reason
        Says how it ended. Not converging never proves that a goal is out of reach.
    iterations, restarts
        Steps taken in all, and random starts used.
    """

    q: Array
    residual: float
    position_error: float
    orientation_error: float
    converged: bool
    reason: str
    iterations: int
    restarts: int


@dataclass(frozen=True, eq=False)
class IkBatch:
    """Results of N problems, as arrays with one row a problem; see `IkResult`."""

    q: Array  # (N, n)
    converged: NDArray[np.bool_]  # (N,)
    position_error: Array  # (N,), m
    orientation_error: Array  # (N,), rad
    iterations: NDArray[np.int64]  # (N,)
    restarts: NDArray[np.int64]  # (N,)


def solve_ik(
    chain: SerialChain,
    goal: Goal,
    *,
    start: Sequence[float] | Array | None = None,
    settings: IkSettings | None = None,
) -> IkResult:
    """Find a posture within the physical limits that reaches a goal.

    A ROD is ``chain.freeze({name: position})``.

    Parameters
    ----------
    start : shape (n,), optional
        Where to begin (moved inside the limits); the middle of the limits by default. A start
        near an answer leads to that answer.

    Raises
    ------
    InputError
        For a start of the wrong length or with NaN.
    """
    settings = settings or IkSettings()
    q = (0.5 * (chain.lower + chain.upper)) if start is None else chain.check_vector(start)
    rotation = _NO_ROTATION if goal.orientation is None else goal.orientation
    # Copies, since a read-only array is a type of its own: the kernel would be compiled again.
    qs, targets, rotations = (
        q[None, :].copy(),
        goal.position[None, :].copy(),
        rotation[None].copy(),
    )
    counts, errors = np.empty((1, 3), dtype=np.int64), np.empty((1, 2))
    solve_rows(
        chain.arrays,
        np.zeros((1, chain.n), dtype=np.bool_),
        np.array([ik_mode(goal)], dtype=np.int64),
        targets,
        rotations,
        ik_control(settings),
        np.array([settings.seed], dtype=np.uint64),
        qs,
        counts,
        errors,
    )
    status, iterations, restarts = counts[0].tolist()
    distance, angle = errors[0].tolist()
    return IkResult(
        qs[0],
        math.hypot(distance, settings.orientation_weight * angle),
        distance,
        angle,
        status == CONVERGED,
        _reason(status, iterations, restarts, distance, angle),
        iterations,
        restarts,
    )


def solve_ik_batch(
    chain: SerialChain,
    goals: Sequence[Goal],
    *,
    starts: Array | None = None,
    frozen: NDArray[np.bool_] | None = None,
    settings: IkSettings | None = None,
    threads: int = 1,
) -> IkBatch:
    """Solve N independent problems, each with joints of its own frozen where its start has them.

    Parameters
    ----------
    goals
        N goals.
    starts : shape (N, n) or (n,), optional
        The middle of the limits by default.
    frozen : shape (N, n) or (n,), optional
        True where a joint stays at its start, even outside its limits; none by default.
    threads
        The answer does not depend on it.

    Raises
    ------
    InputError
        For arrays of other shapes, NaN, or fewer than one thread.
    """
    settings = settings or IkSettings()
    count, n = len(goals), chain.n
    if threads < 1:
        raise InputError('threads', f'is {threads}; must be at least 1')
    middle = 0.5 * (chain.lower + chain.upper)
    qs = _rows(middle if starts is None else starts, (count, n), 'starts', float)
    if not np.isfinite(qs).all():
        raise InputError('starts', 'contain NaN or infinity')
    mask = _rows(np.zeros(n, bool) if frozen is None else frozen, (count, n), 'frozen', bool)
    targets = np.array([goal.position for goal in goals]).reshape(count, 3)
    rotations = np.array(
        [_NO_ROTATION if goal.orientation is None else goal.orientation for goal in goals]
    ).reshape(count, 3, 3)
    modes = np.array([ik_mode(goal) for goal in goals], dtype=np.int64)
    # Each problem has a stream of its own, whichever thread solves it.
    seeds = np.uint64(settings.seed) + np.arange(count, dtype=np.uint64) * np.uint64(0x632BE5AB)
    counts, errors = np.zeros((count, 3), dtype=np.int64), np.zeros((count, 2))
    control = ik_control(settings)

    def work_on(first: int) -> None:
        rows = slice(first, first + _CHUNK)
        solve_rows(
            chain.arrays,
            mask[rows],
            modes[rows],
            targets[rows],
            rotations[rows],
            control,
            seeds[rows],
            qs[rows],
            counts[rows],
            errors[rows],
        )

    chunks = range(0, count, _CHUNK)
    if threads == 1 or len(chunks) < 2:
        for first in chunks:
            work_on(first)
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(work_on, chunks))
    return IkBatch(
        qs, counts[:, 0] == CONVERGED, errors[:, 0], errors[:, 1], counts[:, 1], counts[:, 2]
    )


def _rows(values: NDArray[Any], shape: tuple[int, int], field: str, dtype: type) -> NDArray[Any]:
    """Return a fresh array of the given shape from one row for all or one row each."""
    given: NDArray[Any] = np.asarray(values, dtype=dtype)
    if given.shape not in (shape, shape[1:]):
        raise InputError(field, f'has shape {given.shape}; needs {shape} or {shape[1:]}')
    return np.array(np.broadcast_to(given, shape), order='C')


def _reason(status: int, iterations: int, restarts: int, distance: float, angle: float) -> str:
    if status == CONVERGED:
        return f'converged in {iterations} steps, {restarts} restarts'
    end = 'settled in a local minimum' if status == LOCAL_MINIMUM else 'still moving'
    return (
        f'not reached from {restarts + 1} starts; the closest posture, {end}, misses by '
        f'{distance:.3g} m and {angle:.3g} rad'
    )
