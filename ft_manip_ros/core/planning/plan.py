"""What planning returns: the outcome of every goal, and the motion that visits those it can."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.planning.trajectory import Trajectory


class Outcome(str, Enum):
    """What becomes of one goal."""

    REACHABLE = 'reachable'
    RELAXED = 'relaxed'
    LOST = 'lost'
    UNDECIDED = 'undecided'


class PlanStatus(str, Enum):
    """What becomes of the task."""

    FINISHES = 'finishes'
    PARTIAL = 'partial'
    HALTED = 'halted'
    REFUSED = 'refused'


@dataclass(frozen=True, eq=False)
class GoalOutcome:
    """The fate of one goal.

    Attributes
    ----------
    goal
        As asked for; ``target`` is what the posture reaches: the same, or the goal relaxed.
    index
        Its place in the original task, from 0.
    outcome
        REACHABLE and RELAXED have a verified posture; LOST is proved; UNDECIDED is neither.
    relaxation
        What was given up, e.g. ``'orientation dropped'``; empty unless RELAXED.
    reason
        One sentence for a person.
    position_error, orientation_error
        Of the planned posture, or the best found (m, rad); NaN where there is none or, for the
        orientation, where none was asked for.
    uncertainty
        One standard deviation of the tool position (m) that follows from not knowing exactly
        where the frozen joints stand.
    margin
        How safe the verdict is (m): for a posture, the distance its tool could be moved before
        a joint limit or a singularity is met, to first order; for LOST the proved distance by
        which the goal is missed. NaN where not known.
    posture : ndarray, shape (n,), or None
        Planned posture of the full arm.
    arrival
        When the tool is there, s from the start of the trajectory; NaN unless visited.
    """

    goal: Goal
    index: int
    outcome: Outcome
    relaxation: str
    reason: str
    position_error: float
    orientation_error: float
    uncertainty: float
    margin: float
    target: Goal
    posture: Array | None = None
    arrival: float = float('nan')

    @property
    def has_posture(self) -> bool:
        """True where the arm can go there."""
        return self.posture is not None


@dataclass(frozen=True, eq=False)
class Plan:
    """A decision about a whole task.

    Attributes
    ----------
    status
        HALTED plans carry the stop as their trajectory where the arm was moving.
    reason
        One sentence for a person.
    frozen, sigma
        Positions of the frozen joints and their standard deviations (rad or m), by name.
    outcomes
        In task order.
    trajectory
        Checked, over all joints, frozen ones held; None where nothing is to be sent.
    why_not
        Why goals with known postures are not visited, if that is so.
    pause
        Rest (s) after the stop at the beginning, put in for the time that planning took; part
        of the trajectory and of the arrivals.
    """

    status: PlanStatus
    reason: str
    frozen: Mapping[str, float]
    sigma: Mapping[str, float]
    outcomes: tuple[GoalOutcome, ...]
    trajectory: Trajectory | None = None
    why_not: str = ''
    pause: float = 0.0
