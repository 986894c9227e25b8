"""A motion through the goals that survives as many failures as its self-motions allow.

With the task known beforehand one redundant degree of freedom can be enough for fault tolerance
(Paredis & Khosla, Fault Tolerant Task Execution through Global Trajectory Planning, IJRR 1996):
what counts is where each joint stands while goals remain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.planning import timing
from ft_manip_ros.core.planning.exposure import Exposure
from ft_manip_ros.core.planning.limits import (
    MotionLimits,
    arrays_within,
    motion_limits,
    travel,
)
from ft_manip_ros.core.planning.postures import find_postures
from ft_manip_ros.core.planning.route import folded
from ft_manip_ros.core.planning.settings import PlanSettings
from ft_manip_ros.core.planning.tolerance import reaches_locked
from ft_manip_ros.core.planning.trajectory import Trajectory

# Positions of each joint at which a lock is tried, spread over its operating range.
_GRID = 161
# Postures per goal to choose from, and solver starts to find them.
_POSTURES, _ATTEMPTS = 200, 1500
# Postures that a leg may go by.
_VIAS = 48


@dataclass(frozen=True, eq=False)
class TolerantPath:
    """The motion and when it reaches each goal (s).

    ``survivable``, shape (L + 1, n), says where it is known whether a joint has any position at
    which it may lock while the goals l, l + 1, ... remain.
    """

    trajectory: Trajectory
    arrivals: dict[int, float]
    survivable: NDArray[np.bool_] | None = None


def survival_grid(
    chain: SerialChain, goals: Sequence[Goal], settings: PlanSettings
) -> tuple[Array, NDArray[np.bool_]]:
    """Where a joint may lock while goals remain.

    Returns
    -------
    angles : ndarray, shape (n, A)
        Positions tried (rad or m).
    survived : ndarray, shape (L + 1, n, A)
        ``survived[l, j, a]``: with joint j locked at ``angles[j, a]`` a posture is known for each
        of the goals l, l + 1, ...; all true for l = L, when none remains.
    """
    n, count = chain.n, len(goals)
    lower, upper = chain.operating_lower, chain.operating_upper
    angles = np.linspace(lower, upper, _GRID, axis=1)
    survived = np.ones((count + 1, n, _GRID), dtype=np.bool_)
    middle = 0.5 * (chain.lower + chain.upper)
    for index in range(count - 1, -1, -1):
        for joint in range(n):
            near = middle[None, :]
            for k in range(_GRID):
                found = reaches_locked(
                    chain, goals[index], joint, float(angles[joint, k]), near, settings
                )
                survived[index, joint, k] = bool(len(found.q)) and survived[index + 1, joint, k]
                if len(found.q):
                    near = found.q
    return angles, survived


def most_tolerant_path(
    chain: SerialChain, goals: Sequence[Goal], start: Array, settings: PlanSettings
) -> TolerantPath | None:
    """Visit the goals in order so that the time at which a lock would cost a goal is least.

    The exposure of a move is the time its joints spend at positions where locking would leave
    some later goal without a known posture, summed over the joints; dynamic programming picks
    among many postures per goal, and among less exposed ones to go by on the way, those of least
    total exposure. Then some joints may move before the others.

    Parameters
    ----------
    start : shape (n,)
        Posture at rest.

    Returns
    -------
    TolerantPath or None
        None where some goal has no known posture for the healthy arm.
    """
    limits = motion_limits(chain, operating=True, jerk_time=settings.jerk_time)
    scaled = limits.scaled(settings.rate_scale)
    wide = replace(settings, postures=_POSTURES, attempts=_ATTEMPTS)
    arrays, healthy = arrays_within(chain, limits), np.zeros(chain.n, dtype=np.bool_)
    groups = [start[None, :]]
    for index, goal in enumerate(goals):
        near = groups[-1][: _POSTURES // 2]
        found = find_postures(arrays, healthy, goal, near, wide, seed=settings.seed + index)
        if not len(found.q):
            return None
        groups.append(folded(found.q, start, limits))
    angles, survived = survival_grid(chain, goals, settings)
    legs = [Exposure(angles, rest, scaled) for rest in survived]
    # Every posture known may be gone by on the way to another.
    pool = np.concatenate(groups)
    total = np.zeros(1)
    came: list[NDArray[np.int64]] = []
    for a, b, leg, after in zip(groups, groups[1:], legs, legs[1:], strict=False):
        vias = leg.least(pool, _VIAS)
        around = _least_sums(leg.moves(a, vias), leg.moves(vias, b))
        costs = total[:, None] + np.minimum(leg.moves(a, b), around)
        costs += after.at_rest(b) * settings.dwell
        came.append(np.argmin(costs, axis=0))
        total = np.min(costs, axis=0)
    picks = [int(np.argmin(total))]
    for before in reversed(came[1:]):
        picks.append(int(before[picks[-1]]))
    stops = [start, *(group[k] for group, k in zip(groups[1:], picks[::-1], strict=True))]
    ways = [
        [*leg.best_way(a, b, leg.least(pool, _VIAS)), b]
        for leg, (a, b) in zip(legs, pairwise(stops), strict=False)
    ]
    path = _motion(chain, start, ways, scaled, settings)
    return replace(path, survivable=np.asarray(survived.any(axis=2)))


def _least_sums(first: Array, second: Array) -> Array:
    """Least over v of first[a, v] + second[v, b], shape (A, B)."""
    return np.array([np.min(row[:, None] + second, axis=0) for row in first])


def _motion(
    chain: SerialChain,
    start: Array,
    ways: list[list[Array]],
    limits: MotionLimits,
    settings: PlanSettings,
) -> TolerantPath:
    """The timed motion through the postures of each leg, with a rest at the last one."""
    parts: list[timing.Motion] = []
    arrivals: dict[int, float] = {}
    at, clock = start, 0.0
    for index, way in enumerate(ways):
        for stop in way:
            target = at + travel(at, stop, limits.unlimited)
            parts.append(timing.move_between(at, target, limits, settings.sample_period))
            at = parts[-1].positions[-1]
            clock += parts[-1].duration
        arrivals[index] = clock
        parts.append(timing.hold(at, max(settings.dwell, timing.SHORTEST_STEP)))
        clock += parts[-1].duration
    motion = timing.joined(parts)
    return TolerantPath(
        Trajectory(
            chain.joint_names,
            motion.times,
            motion.positions,
            motion.velocities,
            motion.accelerations,
        ),
        arrivals,
    )
