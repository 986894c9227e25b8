"""How far a task has come: which goals the tool was seen at, and when it was to be at others."""

from __future__ import annotations

from collections.abc import Sequence

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.goal import Goal, Task
from ft_manip_ros.core.planning.decision import Visited
from ft_manip_ros.core.planning.margins import tool_errors
from ft_manip_ros.core.planning.plan import Plan

SECOND = 1_000_000_000  # ns


class Progress:
    """What remains of a task, and what the newest plan promises; stamps are in ns.

    Attributes
    ----------
    remaining
        Places of the goals that the tool has not been measured at yet.
    hints
        Postures, (n,), known for some goals, by place.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.remaining = list(range(len(task.goals)))
        self.hints: dict[int, Array] = {}
        self._promised: dict[int, tuple[int, Goal]] = {}

    def goals_left(self) -> list[tuple[int, Goal]]:
        """Goals that remain, with their places."""
        return [(index, self.task.goals[index]) for index in self.remaining]

    def names(self, places: Sequence[int]) -> str:
        """Goals as a person knows them."""
        return ', '.join(self.task.goals[k].id or f'goal {k}' for k in places)

    def promise(self, plan: Plan, stamp: int) -> None:
        """Take in when the tool is to be where, by a plan whose time 0 is at ``stamp``."""
        self._promised = {
            outcome.index: (stamp + round(outcome.arrival * SECOND), outcome.target)
            for outcome in plan.outcomes
            if outcome.has_posture
        }

    def watch(self, chain: SerialChain, stamp: int, q: Array) -> list[Visited]:
        """Cross off the goals that the tool stands at, (n,), at or after their planned time."""
        visited = []
        for index in list(self.remaining):
            due, goal = self._promised.get(index, (None, None))
            if due is None or goal is None or stamp < due:
                continue
            distance, turn = tool_errors(chain, q, goal)
            if distance <= goal.position_tolerance and not turn > goal.orientation_tolerance:
                self.remaining.remove(index)
                visited.append(Visited(index, goal.id, stamp, distance, turn))
        return visited

    def missed(self, stamp: int) -> list[int]:
        """Goals that remain although the last one was to be visited by ``stamp``."""
        if not self._promised or stamp < max(due for due, _ in self._promised.values()):
            return []
        return [index for index in self._promised if index in self.remaining]
