"""The proof before an announcement: the FTWS engine's verdict on every goal of the task."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import FtwsResult, Verdict
from ft_manip_ros.core.goal import Goal, Task

# A region's cells are cut down to this share of its own size.
_FINEST = 1.0 / 32.0
MOST_CELLS = 5000


@dataclass(frozen=True, eq=False)
class Proof:
    """Verdicts on the goals of a task, in their order.

    The proof stops at the first goal that is no member, so there may be fewer verdicts than
    goals.

    Attributes
    ----------
    verdicts
        For a goal with a region: MEMBER where all of the region is proved.
    goals
        How many the task has.
    covers
        For each verdict the boxes whose circumscribed balls the engine proved, shape (M, 6):
        centre and half edges, m. Together they contain the goal's region; none without one.
    failed_at : ndarray, shape (3,), or None
        The point (m) at which the last verdict failed.
    """

    verdicts: tuple[FtwsResult, ...]
    goals: int
    covers: tuple[Array, ...] = ()
    failed_at: Array | None = None

    @property
    def proved(self) -> bool:
        """True where every goal is a proved member."""
        members = sum(result.verdict is Verdict.MEMBER for result in self.verdicts)
        return members == self.goals

    @property
    def reason(self) -> str:
        """One sentence for a person."""
        if self.proved:
            text = f'all {self.goals} goals are proved members of the FTWS'
            regions = sum(len(cover) > 0 for cover in self.covers)
            cells = sum(len(cover) for cover in self.covers)
            return f'{text}, {regions} whole regions by {cells} proved balls' if regions else text
        last = self.verdicts[-1]
        counts = Counter(result.verdict.value for result in self.verdicts)
        tally = ', '.join(f'{count} {name}' for name, count in sorted(counts.items()))
        return f'goal {len(self.verdicts)} is {last.verdict.value} ({last.reason}); so far {tally}'


def prove(
    chain: SerialChain,
    task: Task,
    order: int,
    should_stop: Callable[[], bool] = lambda: False,
    *,
    most_cells: int = MOST_CELLS,
) -> Proof:
    """Ask the FTWS engine about each goal, up to the first that is not a member.

    Parameters
    ----------
    chain
        The design.
    order
        Joints frozen at once.
    should_stop
        Polled between two questions; what was not asked is UNDECIDED.
    most_cells
        Balls that the engine is asked about for one region.
    """
    verdicts: list[FtwsResult] = []
    covers: list[Array] = []
    failed_at: Array | None = None
    for goal in task.goals:
        cover = np.zeros((0, 6))
        result = _ask(chain, goal, order, 0.0)
        if result.verdict is not Verdict.MEMBER:
            failed_at = goal.position
        elif goal.region is not None:
            result, cover, failed_at = _prove_region(
                chain, goal, order, result, should_stop, most_cells
            )
        verdicts.append(result)
        covers.append(cover)
        if result.verdict is not Verdict.MEMBER or should_stop():
            break
    return Proof(tuple(verdicts), len(task.goals), tuple(covers), failed_at)


def proof_settings(order: int, radius: float) -> FtwsSettings:
    """How hard the engine tries to prove a goal, or the ball of ``radius`` (m) around it."""
    settings = FtwsSettings(intervals=False, radius=radius)
    if order > 1:
        # Boxes of several frozen angles need more postures to choose from, and smaller steps.
        settings = replace(settings, restarts=60, slab=0.1, pieces=1_000_000)
    elif radius > 0.0:
        # A ball that is not proved is cut: no need to try hard on the large ones.
        settings = replace(settings, boxes=1000)
    return settings


def _ask(chain: SerialChain, goal: Goal, order: int, radius: float) -> FtwsResult:
    mode = 'position' if goal.orientation is None else 'pose'
    settings = proof_settings(order, radius)
    return query(chain, [goal], order=order, mode=mode, settings=settings)[0]


def _prove_region(
    chain: SerialChain,
    goal: Goal,
    order: int,
    center: FtwsResult,
    should_stop: Callable[[], bool],
    most_cells: int,
) -> tuple[FtwsResult, Array, Array | None]:
    """Cover a region by boxes, each inside a ball that the engine proves at once.

    A box that is not proved is halved across its longest edge, down to a fixed size.

    Parameters
    ----------
    center
        The verdict on the goal itself, a member.

    Returns
    -------
    result, cover, failed_at
        As in `Proof`.
    """
    region = goal.region
    assert region is not None
    half = region.half
    finest = _FINEST * float(half.max())
    cells = [(np.zeros(3), half)]
    proved: list[Array] = []
    asked = 0
    while cells:
        at, half = cells.pop()
        point = region.nearest(at, half)
        if point is None:
            continue
        asked += 1
        radius = float(np.linalg.norm(half)) * (1.0 + 1e-9)
        result = _ask(chain, replace(goal, position=goal.position + at), order, radius)
        if result.verdict is Verdict.MEMBER:
            proved.append(np.concatenate([goal.position + at, half]))
            continue
        longest = int(np.argmax(half))
        done = half[longest] <= finest or asked >= most_cells or should_stop()
        if done or result.verdict is Verdict.NON_MEMBER:
            # The ball around a box holds points outside the region too, so a ball that is proved
            # lost is lost here as well; one that is merely not proved says nothing of the point.
            where = ', '.join(f'{x:.4g}' for x in goal.position + point)
            reason = f'the {region} is not proved: near ({where}) {result.reason}'
            failed = replace(result, point=center.point, reason=reason)
            return failed, np.zeros((0, 6)), goal.position + point
        shift = np.zeros(3)
        shift[longest] = 0.5 * half[longest]
        smaller = half - shift
        # The outer half first: that is where a cover fails.
        halves = sorted((at - shift, at + shift), key=lambda c: float(np.linalg.norm(c)))
        cells += [(half_center, smaller) for half_center in halves]
    reason = f'the {region} is covered by {len(proved)} proved balls'
    margin = max(center.margin, region.inner_radius)
    return replace(center, margin=margin, reason=reason), np.array(proved), None
