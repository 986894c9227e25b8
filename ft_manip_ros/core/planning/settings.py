"""Everything that can be set about planning, with its unit; validated once."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import Enum

import numpy as np

from ft_manip_ros.core.errors import InputError


class Policy(str, Enum):
    """What to do when a joint has failed."""

    HALT = 'halt'
    FINISH_REACHABLE = 'finish_reachable'
    FINISH_ALL_OR_HALT = 'finish_all_or_halt'


class Order(str, Enum):
    """In which order to visit the goals that remain."""

    GIVEN = 'given'
    FASTEST = 'fastest'
    SAFEST = 'safest'


class Relaxation(str, Enum):
    """What may be given up to reach a goal."""

    FREE_ROLL = 'free roll'
    ORIENTATION_DROPPED = 'orientation dropped'
    LINE_DROPPED = 'line dropped'


@dataclass(frozen=True)
class PlanSettings:
    """How to plan.

    Attributes
    ----------
    policy
        ``halt``: stop. ``finish_reachable``: go on with every goal that a posture is known for.
        ``finish_all_or_halt``: go on only if that is every goal.
    order
        ``given``: the task's. ``fastest``: for little time. ``safest``: largest margin first.
    accepted
        Relaxations with which a goal may be visited; with others it is only reported.
    postures
        Postures to look for per goal.
    attempts
        Solver starts per goal before the search for postures ends.
    ik_tolerance, ik_orientation_tolerance
        Accuracy of the postures (m, rad); each goal's own tolerance decides what counts.
    proof_boxes
        Branch-and-bound boxes per goal to prove it lost, after the plan has left.
    detour_checks
        Moves that may be checked for collision to find ways round, where no straight way is free.
    dwell
        Rest at each goal (s).
    rate_scale
        Share of the arm's speed, acceleration and jerk limits to use; a stop uses them whole.
    jerk_time
        Time (s) to build up full acceleration; arm files give no jerk limit.
    sample_period
        Longest time between two points of a trajectory (s).
    limit_weight
        Seconds that a posture with a joint at the end of its range counts as more expensive than
        one with all joints in the middle of theirs.
    seed
        Of the random starts.
    """

    policy: Policy = Policy.FINISH_REACHABLE
    order: Order = Order.GIVEN
    accepted: frozenset[Relaxation] = frozenset()
    postures: int = 8
    attempts: int = 24
    ik_tolerance: float = 1e-6
    ik_orientation_tolerance: float = 1e-6
    proof_boxes: int = 50_000
    detour_checks: int = 1000
    dwell: float = 0.2
    rate_scale: float = 0.95
    jerk_time: float = 0.1
    sample_period: float = 0.1
    limit_weight: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, (int, float)) and not np.isfinite(value):
                raise InputError(f'planning: {field.name}', f'is {value}; must be finite')
        for key in ('ik_tolerance', 'ik_orientation_tolerance', 'jerk_time', 'sample_period'):
            if getattr(self, key) <= 0.0:
                raise InputError(f'planning: {key}', f'is {getattr(self, key)}; must be > 0')
        for key in ('detour_checks', 'dwell', 'limit_weight', 'seed'):
            if getattr(self, key) < 0:
                raise InputError(f'planning: {key}', f'is {getattr(self, key)}; must be >= 0')
        for key in ('postures', 'attempts', 'proof_boxes'):
            if getattr(self, key) < 1:
                raise InputError(f'planning: {key}', f'is {getattr(self, key)}; must be >= 1')
        if not 0.0 < self.rate_scale <= 1.0:
            raise InputError('planning: rate_scale', f'is {self.rate_scale}; needs 0 < x <= 1')
