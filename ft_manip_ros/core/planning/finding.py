"""What was found out about one goal, and what becomes of it as more is known."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.planning.plan import Outcome
from ft_manip_ros.core.planning.postures import Postures
from ft_manip_ros.core.planning.settings import Relaxation


@dataclass(frozen=True, eq=False)
class Finding:
    """What was found out about one goal.

    Attributes
    ----------
    goal
        As asked for; ``relaxed`` is what the postures reach.
    relaxation
        What was given up, or None.
    miss
        Proved distance (m) by which the goal is missed; only for LOST.
    """

    goal: Goal
    index: int
    outcome: Outcome
    relaxed: Goal
    relaxation: Relaxation | None
    postures: Postures
    reason: str
    miss: float = float('nan')

    def left_open(self, reason: str) -> Finding:
        """Return the goal as undecided; the postures, if any, lead nowhere."""
        return replace(self, outcome=Outcome.UNDECIDED, reason=reason)

    def without_postures(self, reason: str) -> Finding:
        """Return the goal as undecided, for no posture of it will do."""
        none = replace(self.postures, q=self.postures.q[:0])
        return replace(self.left_open(reason), relaxation=None, postures=none)

    def relaxed_to(self, goal: Goal, relaxation: Relaxation, reason: str) -> Finding:
        """Return the goal as reached in these postures if something is given up."""
        return replace(
            self, outcome=Outcome.RELAXED, relaxed=goal, relaxation=relaxation, reason=reason
        )
