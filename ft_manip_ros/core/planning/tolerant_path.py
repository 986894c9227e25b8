"""A motion through the goals that survives as many failures as its self-motions allow.

With the task known beforehand one redundant degree of freedom can be enough for fault tolerance
(Paredis & Khosla, Fault Tolerant Task Execution through Global Trajectory Planning, IJRR 1996):
what counts is where each joint stands while goals remain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import FULL_TURN, Array, SerialChain
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.planning import timing
from ft_manip_ros.core.planning.limits import (
    MotionLimits,
    arrays_within,
    motion_limits,
    travel,
)
from ft_manip_ros.core.planning.postures import find_postures
from ft_manip_ros.core.planning.route import folded
from ft_manip_ros.core.planning.sequence import straight_time
from ft_manip_ros.core.planning.settings import PlanSettings
from ft_manip_ros.core.planning.tolerance import reaches_locked
from ft_manip_ros.core.planning.trajectory import Trajectory

# Positions of each joint at which a lock is tried, spread over its operating range.
_GRID = 161
# Instants of each move that are looked at.
_INSTANTS = 25
# Seconds of exposure that one second of motion is worth: decides between equals only.
_TIME_WEIGHT = 1e-3
# Postures per goal to choose from, and solver starts to find them.
_POSTURES, _ATTEMPTS = 48, 300


@dataclass(frozen=True, eq=False)
class TolerantPath:
    """The motion and when it reaches each goal (s)."""

    trajectory: Trajectory
    arrivals: dict[int, float]


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
    among many postures per goal those of least total exposure.

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
    total = np.zeros(1)
    came: list[NDArray[np.int64]] = []
    for index in range(len(goals)):
        exposure = _exposures(
            groups[index], groups[index + 1], angles, survived[index], scaled, settings.dwell,
            survived[index + 1],
        )  # fmt: skip
        costs = total[:, None] + exposure
        came.append(np.argmin(costs, axis=0))
        total = np.min(costs, axis=0)
    pick = int(np.argmin(total))
    picks = [pick]
    for before in reversed(came[1:]):
        picks.append(int(before[picks[-1]]))
    return _motion(chain, start, groups[1:], picks[::-1], scaled, settings)


def _exposures(
    a: Array,
    b: Array,
    angles: Array,
    before: NDArray[np.bool_],
    limits: MotionLimits,
    dwell: float,
    after: NDArray[np.bool_],
) -> Array:
    """Exposure (s) of the moves from each of a, (K, n), to each of b, (M, n), and the rest there.

    ``before`` and ``after``, (n, A), say where joints may lock under way and at the goal.
    """
    tau = np.linspace(0.0, 1.0, _INSTANTS)
    # The rest-to-rest profile, near enough for weighing one move against another.
    s = tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2)
    at_rest = np.sum(~_may_lock(b, angles, after, limits.turns), axis=1) * dwell
    costs = np.empty((len(a), len(b)))
    for k in range(len(a)):
        way = travel(a[k], b, limits.unlimited)
        q = a[k] + s[:, None, None] * way
        exposed = np.sum(~_may_lock(q, angles, before, limits.turns), axis=2).mean(axis=0)
        for m in range(len(b)):
            time = straight_time(
                a[k], b[m], limits.unlimited, limits.velocity, limits.acceleration, limits.jerk
            )
            costs[k, m] = time * (exposed[m] + _TIME_WEIGHT) + at_rest[m]
    return costs


def _may_lock(
    q: Array, angles: Array, survived: NDArray[np.bool_], turns: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Tell for joint positions (..., n) whether both grid neighbours survive a lock."""
    lower, upper = angles[:, 0], angles[:, -1]
    # A joint that turns on and on passes the same places again.
    q = np.where(turns, lower + np.mod(q - lower, FULL_TURN), q)
    place = (np.clip(q, lower, upper) - lower) / (upper - lower) * (angles.shape[1] - 1)
    below = np.floor(place).astype(np.int64)
    above = np.ceil(place).astype(np.int64)
    joints = np.arange(len(lower))
    return np.asarray(survived[joints, below] & survived[joints, above])


def _motion(
    chain: SerialChain,
    start: Array,
    groups: list[Array],
    picks: list[int],
    limits: MotionLimits,
    settings: PlanSettings,
) -> TolerantPath:
    """The timed motion through the chosen postures, with a rest at each."""
    parts: list[timing.Motion] = []
    arrivals: dict[int, float] = {}
    at, clock = start, 0.0
    for index, (group, pick) in enumerate(zip(groups, picks, strict=True)):
        target = at + travel(at, group[pick], limits.unlimited)
        move = timing.move_between(at, target, limits, settings.sample_period)
        at = move.positions[-1]
        arrivals[index] = clock + move.duration
        rest = timing.hold(at, max(settings.dwell, timing.SHORTEST_STEP))
        clock = arrivals[index] + rest.duration
        parts += [move, rest]
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
