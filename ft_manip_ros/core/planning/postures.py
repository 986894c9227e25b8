"""Several postures of a degraded arm for each goal: one near the arm, others elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.ik_kernels import descend
from ft_manip_ros.core.ik_settings import IkSettings, ik_control, ik_mode
from ft_manip_ros.core.ik_settle import settle
from ft_manip_ros.core.ik_types import (
    CONVERGED,
    IkControl,
    ik_work,
    splitmix,
    uniform,
)
from ft_manip_ros.core.joint import FULL_TURN
from ft_manip_ros.core.planning.settings import PlanSettings

# Postures nearer than this in every joint (rad or m) count as one.
_SAME_POSTURE = 0.05
# Starts spent on a goal for which no posture was found yet, per start of `PlanSettings.attempts`.
_PATIENCE = 4
_NO_ROTATION = np.eye(3)


@dataclass(frozen=True, eq=False)
class Postures:
    """What the search found for one goal.

    Attributes
    ----------
    q : ndarray, shape (K, n)
        Postures of the full arm at the goal, frozen joints in place, the nearest first; K may
        be 0.
    best : ndarray, shape (n,)
        The posture with the least error, whether it counts or not.
    position_error, orientation_error
        Of ``best`` (m, rad); the orientation error is 0 where none is asked for.
    """

    q: Array
    best: Array
    position_error: float
    orientation_error: float


@kernel
def _is_new(q: Array, found: Array, count: int, wraps: NDArray[np.bool_]) -> bool:
    for k in range(count):
        apart = 0.0
        for i in range(q.shape[0]):
            d = q[i] - found[k, i]
            if wraps[i]:
                d -= round(d / FULL_TURN) * FULL_TURN
            apart = max(apart, abs(d))
        if apart < _SAME_POSTURE:
            return False
    return True


@njit(cache=True, nogil=True)
def _search(
    chain: ChainArrays,
    frozen: NDArray[np.bool_],
    mode: int,
    position: Array,
    rotation: Array,
    control: IkControl,
    near: Array,
    attempts: int,
    seed: int,
    most: int,
) -> tuple[Array, Array, float, float]:
    """Return postures, (K, n), ``most`` of them at most; the best one, (n,), and its errors.

    Starts are the rows of ``near`` (S, n), then random ones; a goal without any posture gets
    `_PATIENCE` times as many.
    """
    n = near.shape[1]
    found, best, q = np.empty((most, n)), near[0].copy(), np.empty(n)
    work = ik_work(n, chain.screws.shape[0])
    state = np.uint64(seed)
    count, attempt = 0, 0
    least = np.inf
    best_position, best_orientation = np.inf, np.inf
    while count < most:
        if attempt >= attempts * (1 if count > 0 else _PATIENCE):
            break
        for i in range(n):
            q[i] = near[0, i]
            if frozen[i]:
                continue
            if attempt < near.shape[0]:
                q[i] = near[attempt, i]
            else:
                state = splitmix(state)
                q[i] = chain.lower[i] + uniform(state) * (chain.upper[i] - chain.lower[i])
        attempt += 1
        status, _, pe, oe = descend(chain, frozen, mode, position, rotation, control, q, work)
        cost = pe * pe + (control.weight * oe) ** 2
        if cost < least:
            least, best_position, best_orientation = cost, pe, oe
            best[:] = q
        if status == CONVERGED and _is_new(q, found, count, chain.wraps):
            found[count] = q
            count += 1
    if count == 0:
        _, _, best_position, best_orientation = settle(
            chain, frozen, mode, position, rotation, control, best, work
        )
    return found[:count], best, best_position, best_orientation


def find_postures(
    chain: ChainArrays,
    frozen: NDArray[np.bool_],
    goal: Goal,
    near: Array,
    settings: PlanSettings,
    *,
    seed: int,
) -> Postures:
    """Look for postures that reach a goal with some joints frozen.

    Finding none proves nothing.

    Parameters
    ----------
    chain
        The full arm, with the limits to obey.
    frozen : shape (n,)
        True for frozen joints.
    goal
        Reached when the errors are within its own tolerances; a posture at the accuracy of the
        settings is preferred.
    near : shape (S, n)
        Postures to start from, the preferred one first; frozen joints at their positions.
    seed
        Of the random starts.
    """
    # A copy, since a read-only array is a type of its own: the kernel would be compiled again.
    rotation = np.array(_NO_ROTATION if goal.orientation is None else goal.orientation)
    found, best, position_error, orientation_error = _search(
        chain,
        frozen,
        ik_mode(goal),
        goal.position,
        rotation,
        _control(settings.ik_tolerance, settings.ik_orientation_tolerance),
        np.ascontiguousarray(near),
        settings.attempts,
        seed,
        settings.postures,
    )
    if not len(found) and _counts(goal, position_error, orientation_error):
        found = best[None, :].copy()
    return Postures(found, best, position_error, orientation_error)


@lru_cache(maxsize=8)
def _control(tolerance: float, orientation_tolerance: float) -> IkControl:
    return ik_control(IkSettings(tolerance, orientation_tolerance, restarts=0))


def _counts(goal: Goal, position_error: float, orientation_error: float) -> bool:
    """Tell whether errors are within the goal's own tolerances."""
    return bool(
        position_error <= goal.position_tolerance
        and orientation_error <= goal.orientation_tolerance
    )
