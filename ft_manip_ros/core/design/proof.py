"""The proof before an announcement: the FTWS engine's verdict on every goal of the task."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import FtwsResult, Verdict
from ft_manip_ros.core.goal import Goal, Task

_CORNERS = tuple(product((-1.0, 1.0), repeat=3))
# Cubes of a ball are cut down to this share of its radius.
_FINEST = 16.0


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


def prove(chain: SerialChain, task: Task, order: int, ball: float = 0.0) -> Proof:
    """Ask the FTWS engine about each goal, up to the first that is not a member.

    Parameters
    ----------
    chain
        The design.
    order
        Joints frozen at once.
    ball
        Radius (m) of the ball around every goal that has to be proved with it.
    """
    verdicts: list[FtwsResult] = []
    for goal in task.goals:
        result = _ask(chain, goal, order, 0.0)
        if ball > 0.0 and result.verdict is Verdict.MEMBER:
            result = _cover(chain, goal, order, ball, result)
        verdicts.append(result)
        if result.verdict is not Verdict.MEMBER:
            break
    return Proof(tuple(verdicts), len(task.goals))


def _ask(chain: SerialChain, goal: Goal, order: int, radius: float) -> FtwsResult:
    mode = 'position' if goal.orientation is None else 'pose'
    settings = FtwsSettings(intervals=False, radius=radius)
    if order > 1:
        # Boxes of several frozen angles need more postures to choose from, and smaller steps.
        settings = replace(settings, restarts=60, slab=0.1, pieces=1_000_000)
    if radius > 0.0:
        # A ball that is not proved is halved: no need to try hard on the large ones.
        settings = replace(settings, boxes=1000)
    return query(chain, [goal], order=order, mode=mode, settings=settings)[0]


def _cover(
    chain: SerialChain, goal: Goal, order: int, ball: float, centre: FtwsResult
) -> FtwsResult:
    """Prove a whole ball by cubes, each inside a ball that the engine proves at once.

    A cube that is not proved is cut in eight, down to a fixed size; ``centre`` is the verdict on
    the goal itself.
    """
    cubes = [(goal.position, ball)]
    proved = 0
    while cubes:
        at, half = cubes.pop()
        nearest = np.maximum(np.abs(at - goal.position) - half, 0.0)
        if np.linalg.norm(nearest) > ball:
            continue
        radius = float(np.sqrt(3.0) * half)
        result = _ask(chain, replace(goal, position=at), order, radius)
        if result.verdict is Verdict.MEMBER:
            proved += 1
            continue
        inside = np.linalg.norm(at - goal.position) <= ball
        if half <= ball / _FINEST or (result.verdict is Verdict.NON_MEMBER and inside):
            where = ', '.join(f'{x:.4g}' for x in at)
            reason = f'the ball of {ball:g} m is not proved: at ({where}) {result.reason}'
            return replace(result, point=centre.point, reason=reason)
        cubes += [(at + 0.5 * half * np.array(corner), 0.5 * half) for corner in _CORNERS]
    reason = f'the ball of {ball:g} m is covered by {proved} proved balls'
    return replace(centre, margin=ball, reason=reason)
