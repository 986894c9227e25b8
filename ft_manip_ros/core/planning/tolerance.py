"""Before a failure: at which instants of a motion a lock of which joint would be survived."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.planning.postures import Postures, find_postures
from ft_manip_ros.core.planning.reach import proved_miss
from ft_manip_ros.core.planning.refutation import refute_goal
from ft_manip_ros.core.planning.settings import PlanSettings
from ft_manip_ros.core.planning.trajectory import Trajectory


class Fate(IntEnum):
    """What becomes of the rest of the task if a joint locks then and there."""

    LOST = 0  # proved: at least one remaining goal is out of reach
    OPEN = 1  # neither posture nor proof for some remaining goal
    SURVIVED = 2  # a posture is known for every remaining goal


@dataclass(frozen=True, eq=False)
class ToleranceMap:
    """Instants by joints.

    Attributes
    ----------
    times : ndarray, shape (T,)
        s from the start of the motion.
    fates : ndarray, shape (T, n)
        `Fate` of the rest of the task.
    culprits : ndarray, shape (T, n)
        First goal that is not known to survive, -1 where all do.
    """

    joint_names: tuple[str, ...]
    times: Array
    fates: NDArray[np.int8]
    culprits: NDArray[np.int64]

    @property
    def survived(self) -> Array:
        """Share of the instants at which each joint may lock, shape (n,)."""
        return np.asarray(np.mean(self.fates == Fate.SURVIVED, axis=0))

    @property
    def proved_lost(self) -> Array:
        """Share of the instants at which a lock of each joint is proved to lose a goal, (n,)."""
        return np.asarray(np.mean(self.fates == Fate.LOST, axis=0))

    def stretches(self) -> list[tuple[int, float, float, Fate, int]]:
        """Where a lock is not known to be survived: joint, from and to (s), fate, first goal.

        By joint and time; an instant stands for the time up to the next one.
        """
        found = []
        step = float(self.times[1] - self.times[0])
        for joint in range(len(self.joint_names)):
            marks = list(zip(self.fates[:, joint], self.culprits[:, joint], strict=True))
            for (fate, goal), rows in groupby(range(len(marks)), key=lambda row: marks[row]):
                if fate != Fate.SURVIVED:
                    at = list(rows)
                    begin, end = float(self.times[at[0]]), float(self.times[at[-1]]) + step
                    found.append((joint, begin, end, Fate(fate), int(goal)))
        return found

    @property
    def exposed(self) -> float:
        """Time (s) for which some joint may not lock."""
        return (1.0 - self.any_joint) * float(self.times[-1])

    @property
    def any_joint(self) -> float:
        """Share of the instants at which whichever joint may lock."""
        return float(np.mean(np.all(self.fates == Fate.SURVIVED, axis=1)))


def reaches_locked(
    chain: SerialChain,
    goal: Goal,
    joint: int,
    angle: float,
    near: Array,
    settings: PlanSettings,
) -> Postures:
    """Look for one posture that reaches a goal with one joint locked.

    Parameters
    ----------
    angle
        Where the joint is locked (rad or m).
    near : shape (S, n)
        Postures to start from.
    """
    starts = np.array(near)
    starts[:, joint] = angle
    frozen = np.zeros(chain.n, dtype=np.bool_)
    frozen[joint] = True
    one = replace(settings, postures=1)
    return find_postures(chain.arrays, frozen, goal, starts, one, seed=settings.seed)


def tolerance_map(
    chain: SerialChain,
    goals: Sequence[Goal],
    trajectory: Trajectory,
    arrivals: Mapping[int, float],
    *,
    samples: int,
    settings: PlanSettings,
) -> ToleranceMap:
    """Judge a motion of the healthy arm instant by instant and joint by joint.

    A lock at an instant leaves the goals whose arrival is later. Locked joints may use the
    physical limits of the others.

    Parameters
    ----------
    arrivals
        When each goal is reached, by its place (s from the start of the trajectory).
    samples
        Number of instants, spread evenly.
    """
    times = np.linspace(0.0, trajectory.duration, samples)
    path = trajectory.path()
    fates = np.full((samples, chain.n), Fate.SURVIVED, dtype=np.int8)
    culprits = np.full((samples, chain.n), -1, dtype=np.int64)
    # The posture that answered for the instant before is the best start for the next.
    known: dict[tuple[int, int], Array] = {}
    order = sorted(arrivals, key=lambda index: arrivals[index])
    for row, time in enumerate(times):
        q, _ = path.sample(float(time))
        for joint in range(chain.n):
            for index in order:
                if arrivals[index] <= time:
                    continue
                start = known.get((joint, index))
                near = q[None, :] if start is None else np.array([start, q])
                angle = float(q[joint])
                found = reaches_locked(chain, goals[index], joint, angle, near, settings)
                if len(found.q):
                    known[joint, index] = found.q[0]
                    continue
                fate = _without_posture(chain, goals[index], joint, angle, found, settings)
                if fate < fates[row, joint]:
                    fates[row, joint], culprits[row, joint] = fate, index
                if fate == Fate.LOST:
                    break
    return ToleranceMap(chain.joint_names, times, fates, culprits)


def _without_posture(
    chain: SerialChain,
    goal: Goal,
    joint: int,
    angle: float,
    found: Postures,
    settings: PlanSettings,
) -> Fate:
    """Fate of a goal for which the search found nothing: a bound, branch and bound, or open."""
    frozen = {chain.joint_names[joint]: angle}
    miss, _ = proved_miss(chain.freeze(frozen), goal)
    if miss > goal.position_tolerance:
        return Fate.LOST
    refutation = refute_goal(
        chain,
        chain.arrays,
        goal,
        frozen=frozen,
        sigma={},
        position_error=found.position_error,
        orientation_error=found.orientation_error,
        boxes=settings.proof_boxes,
    )
    if refutation.posture is not None and goal.orientation is None:
        return Fate.SURVIVED
    return Fate.LOST if refutation.miss > 0.0 else Fate.OPEN
