"""The proof before an announcement: the FTWS engine's verdict on every goal of the task."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.verdict import FtwsResult, Verdict
from ft_manip_ros.core.goal import Task


@dataclass(frozen=True, eq=False)
class Proof:
    """Verdicts on the goals of a task, in their order.

    The proof stops at the first goal that is no member, so there may be fewer verdicts than
    goals.
    """

    verdicts: tuple[FtwsResult, ...]
    goals: int

    @property
    def proved(self) -> bool:
        """True where every goal is a proved member."""
        members = sum(result.verdict is Verdict.MEMBER for result in self.verdicts)
        return members == self.goals

    @property
    def reason(self) -> str:
        """One sentence for a person."""
        if self.proved:
            return f'all {self.goals} goals are proved members of the FTWS'
        last = self.verdicts[-1]
        counts = Counter(result.verdict.value for result in self.verdicts)
        tally = ', '.join(f'{count} {name}' for name, count in sorted(counts.items()))
        return f'goal {len(self.verdicts)} is {last.verdict.value} ({last.reason}); so far {tally}'


def prove(chain: SerialChain, task: Task, order: int) -> Proof:
    """Ask the FTWS engine about each goal, up to the first that is not a member.

    Parameters
    ----------
    chain
        The design.
    order
        Joints frozen at once.
    """
    verdicts: list[FtwsResult] = []
    for goal in task.goals:
        mode = 'position' if goal.orientation is None else 'pose'
        verdicts += query(chain, [goal], order=order, mode=mode)
        if verdicts[-1].verdict is not Verdict.MEMBER:
            break
    return Proof(tuple(verdicts), len(task.goals))
