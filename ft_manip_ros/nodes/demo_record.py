"""What happened in one run of the demo, as plain data, and what is wrong with it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.goal import Task
from ft_manip_ros.core.joint_path import JointPath

# Largest distance between the tool and a point that was reached (m).
REACHED = 1e-3
# How far the frozen position may be from where the joint truly stands (rad or m).
FROZEN_ERROR = 2e-3
# Numerical slack on commanded limits, relative.
_LIMIT_SLACK = 1e-3
# A joint that holds its place shows no more than its encoder's noise (rad or m).
_STANDS = 1e-3
_SECOND = 1e9


@dataclass
class Point:
    """One goal of the task and what became of it.

    ``fate`` is 'reached before', 'reachable', 'relaxed', 'lost' or 'undecided'; ``error`` (m) is
    the smallest measured distance of the tool, at stamp ``at`` (ns), after the failure for what
    remained then.
    """

    name: str
    position: Array
    fate: str
    reason: str
    error: float
    at: int

    @property
    def planned(self) -> bool:
        """Whether the re-planner promised to go there."""
        return self.fate in ('reachable', 'relaxed')

    @property
    def reached(self) -> bool:
        """Whether the tool was there."""
        return self.error <= REACHED


@dataclass
class Record:
    """One run. Stamps in ns of the ROS clock, positions in rad or m."""

    chain: SerialChain
    task: Task
    joint: str
    fault_tolerant: bool
    stamps: Array = field(default_factory=lambda: np.zeros(0))  # (T,)
    positions: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (T, n)
    commands: list[tuple[int, JointPath]] = field(default_factory=list)  # start stamp, motion
    started: int = 0
    locked_at: int = 0
    frozen_truth: float = float('nan')
    detected_stamp: int = 0  # of the sample that confirmed it
    detected_heard: int = 0
    detected_position: float = float('nan')
    detected_sigma: float = float('nan')
    cause: str = ''
    falsely_locked: tuple[str, ...] = ()
    plan_heard: int = 0
    plan_status: str = ''
    plan_reason: str = ''
    compute_time: float = float('nan')
    points: list[Point] = field(default_factory=list)

    @property
    def detection_latency(self) -> float:
        """Seconds from the lock to the published fault."""
        return (self.detected_heard - self.locked_at) / _SECOND

    @property
    def plan_latency(self) -> float:
        """Seconds from the lock to the published plan."""
        return (self.plan_heard - self.locked_at) / _SECOND

    @property
    def worst_error(self) -> float:
        """Largest error of the points that were promised after the failure (m)."""
        return max((p.error for p in self.points if p.planned), default=float('nan'))

    def distances(self) -> Array:
        """Distance of the measured tool from each goal, shape (T, goals), m."""
        # Brings the compiler, which the demo needs only when all has happened.
        from ft_manip_ros.core.kinematics import fk

        _, tool = fk(self.chain, self.positions)
        goals = np.array([goal.position for goal in self.task.goals])
        return np.asarray(np.linalg.norm(tool[:, None, :] - goals[None], axis=2))

    def problems(self) -> list[str]:
        """Everything that contradicts the story, in words; empty: it all happened."""
        found = []
        index = self.chain.index(self.joint)
        after = self.stamps > self.locked_at + 0.1 * _SECOND
        spread = float(np.ptp(self.positions[after, index])) if after.any() else float('nan')
        if not spread <= _STANDS:
            found.append(f'{self.joint} moved by {spread:.2g} after it had locked')
        error = abs(self.detected_position - self.frozen_truth)
        if not error <= FROZEN_ERROR:
            found.append(f'the monitor is wrong by {error:.2g} about where {self.joint} stands')
        if self.falsely_locked:
            found.append(f'healthy joints were called locked: {", ".join(self.falsely_locked)}')
        if self.fault_tolerant and self.plan_status != 'finishes':
            found.append(
                f'the points are proved fault tolerant, but the plan {self.plan_status}: '
                f'{self.plan_reason}'
            )
        for point in self.points:
            if (point.planned or point.fate == 'reached before') and not point.reached:
                found.append(f'{point.name} was missed by {point.error * 1e3:.2f} mm')
        return found + self._unsafe_commands(index)

    def _unsafe_commands(self, index: int) -> list[str]:
        chain, found = self.chain, []
        for start, path in self.commands:
            times = np.arange(0.0, path.duration, 0.005)
            states = [path.sample(float(t)) for t in times] or [path.sample(path.duration)]
            q = np.array([position for position, _ in states])
            v = np.array([velocity for _, velocity in states])
            frozen = start >= self.detected_stamp > 0
            if frozen and np.ptp(path.positions[:, index]) > 0.0:
                found.append(f'{self.joint} was commanded to move after it had locked')
            fast = np.abs(v).max(axis=0) > chain.velocity * (1.0 + _LIMIT_SLACK)
            beyond = (q.min(axis=0) < chain.lower - _LIMIT_SLACK) | (
                q.max(axis=0) > chain.upper + _LIMIT_SLACK
            )
            beyond &= ~chain.arrays.wraps
            # It stands where it stands, be that at or beyond its limit.
            beyond[index] &= not frozen
            for bad, what in ((fast, 'speed'), (beyond, 'position')):
                names = [chain.joint_names[i] for i in np.flatnonzero(bad)]
                if names:
                    found.append(f'{what} limits were exceeded in command: {", ".join(names)}')
        return found
