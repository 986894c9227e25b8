"""What the executive is told and what it answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ft_manip_ros.core.planning.plan import Plan


@dataclass(frozen=True)
class ExecutiveSettings:
    """How the executive watches the arm.

    Attributes
    ----------
    state_timeout
        A measured state older than this (s) is not planned from.
    freshness
        Where newer states are on their way, a state that has waited this long (s) to be planned
        from is passed over.
    velocity_window
        Where joint states carry no velocities, they are fitted to the positions of this long (s).
    patience
        Time (s) after the last planned arrival before goals that were not met are planned again.
    retries
        How often that is done between two changes of the frozen joints.
    """

    state_timeout: float = 0.5
    freshness: float = 0.1
    velocity_window: float = 0.05
    patience: float = 0.4
    retries: int = 5


@dataclass(frozen=True, eq=False)
class Decision:
    """A plan that the arm is to follow from now on.

    Attributes
    ----------
    stamp
        Of the measured state that the plan starts from (ns): its trajectory's time 0.
    cause
        What made it necessary, one clause.
    degraded
        False for the plan of the healthy arm.
    restated
        True where the motion is under way already and only its report has become better known.
    """

    plan: Plan
    stamp: int
    cause: str
    degraded: bool
    restated: bool = False


@dataclass(frozen=True)
class Visited:
    """A goal at which the tool was measured within its tolerances."""

    index: int
    id: str
    stamp: int
    position_error: float
    orientation_error: float


def cause_of(frozen: Mapping[str, float], cleared: Sequence[str], runaway: Sequence[str]) -> str:
    """Say why a changed fault state makes a new plan necessary.

    Parameters
    ----------
    frozen
        Positions (rad or m) of the joints that were not frozen before, by name.
    """
    changes = [f'{name} frozen at {at:.4f}' for name, at in frozen.items()]
    changes += [f'{name} cleared' for name in cleared]
    changes += [f'{name} runs away' for name in runaway]
    return ', '.join(changes) or 'a frozen position was corrected'
