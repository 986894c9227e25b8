"""Goals that ask for a straight way: which lines the joints can follow, and what that leaves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays, SerialChain
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.finding import Finding
from ft_manip_ros.core.planning.settings import PlanSettings, Relaxation

if TYPE_CHECKING:
    from ft_manip_ros.core.planning.line import Line

# For each posture of a goal the line that ends there, with the place of the posture in which it
# begins among those of the goal before (0 where it begins where the arm comes to rest).
Lines = Mapping[int, Sequence[tuple[int, 'Line']]]


def straighten(
    chain: SerialChain,
    arrays: ChainArrays,
    frozen: NDArray[np.bool_],
    findings: Sequence[Finding],
    here: Array,
    settings: PlanSettings,
    checker: CollisionChecker | None,
) -> tuple[list[Finding], Lines]:
    """Trace the lines to all goals that ask for one, and judge these goals by them.

    A line begins at the goal before it of those that remain, in each of its postures; that to the
    first one begins where the arm comes to rest. A goal that no line leads to counts as relaxed,
    with the line dropped: other postures than those found might allow it, so nothing is proved.

    Parameters
    ----------
    chain, arrays
        The full arm, and the same with the limits to obey.
    frozen : shape (n,)
    findings
        Of all remaining goals, in order.
    here : shape (n,)
        Where the arm comes to rest.

    Returns
    -------
    findings
        With the postures that the lines end in, for goals that are reached straight.
    lines
        By place of these goals in the original task.
    """
    judged: list[Finding] = []
    lines: dict[int, list[tuple[int, Line]]] = {}
    for finding in findings:
        if not (finding.goal.straight_line and len(finding.postures.q)):
            judged.append(finding)
            continue
        # Brings splines and rotations of SciPy, slow to import, which few tasks need.
        from ft_manip_ros.core.planning.line import trace

        origin, starts = 'where the arm stands', here[None, :]
        if judged:
            before = judged[-1]
            origin = before.goal.id or f'goal {before.index}'
            starts = before.postures.q if _is_visited(before, settings) else here[None, :][:0]
        traced = [
            trace(chain, arrays, frozen, start, finding.relaxed, settings, checker)
            for start in starts
        ]
        whole = [(a, line) for a, line in enumerate(traced) if not line.reason]
        if whole:
            lines[finding.index] = whole
            found = replace(finding.postures, q=np.array([line.end for _, line in whole]))
            reason = f'{len(whole)} of {len(traced)} straight lines from {origin} can be followed'
            finding = replace(finding, postures=found, reason=reason)
        else:
            finding = _without_line(finding, origin, traced)
        judged.append(finding)
    return judged, lines


def _is_visited(finding: Finding, settings: PlanSettings) -> bool:
    accepted = finding.relaxation is None or finding.relaxation in settings.accepted
    return accepted and len(finding.postures.q) > 0


def _without_line(finding: Finding, origin: str, traced: Sequence[Line]) -> Finding:
    """A goal that no line leads to, with how far the best one came and why it ends."""
    if traced:
        best = max(traced, key=lambda line: line.fraction)
        share = f'ends after {100.0 * best.fraction:.0f} % of the way: {best.reason}'
    else:
        share = f'has no beginning: {origin} is not visited'
    reason = f'the straight line from {origin} {share}'
    if finding.relaxation is None:
        way_free = replace(finding.goal, straight_line=False)
        return finding.relaxed_to(way_free, Relaxation.LINE_DROPPED, reason)
    return finding.without_postures(f'with the {finding.relaxation.value}, {reason}')
