"""From findings and the motion to the outcome of each goal, in numbers and words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.planning.finding import Finding
from ft_manip_ros.core.planning.margins import (
    frame_errors,
    posture_margins,
    tool_uncertainties,
)
from ft_manip_ros.core.planning.plan import GoalOutcome, Outcome, PlanStatus
from ft_manip_ros.core.planning.route import Visit


def outcomes_of(
    chain: SerialChain,
    findings: Sequence[Finding],
    visits: Mapping[int, Visit],
    frozen: Mapping[str, float],
    sigma: Mapping[str, float],
) -> tuple[GoalOutcome, ...]:
    """Outcome of each goal; ``visits`` are those of the motion, by place of the goal."""
    postures = []
    for finding in findings:
        visit, found = visits.get(finding.index), finding.postures
        postures.append(visit.posture if visit else [*found.q[:1], found.best][0])
    qs = np.array(postures).reshape(-1, chain.n)
    rotations, positions = fk(chain, qs)
    uncertainties = tool_uncertainties(chain, qs, sigma).tolist()
    margins = posture_margins(chain, qs, frozen).tolist()
    return tuple(
        _outcome(
            finding,
            visits.get(finding.index),
            frame_errors(rotations[k], positions[k], finding.relaxed),
            uncertainties[k],
            margins[k],
        )
        for k, finding in enumerate(findings)
    )


def _outcome(
    finding: Finding,
    visit: Visit | None,
    errors: tuple[float, float],
    uncertainty: float,
    margin: float,
) -> GoalOutcome:
    """Outcome of one goal by what is known of its posture; without ``visit`` none goes there."""
    relaxation = '' if finding.relaxation is None else finding.relaxation.value
    reason = finding.reason
    if len(finding.postures.q):
        if 2.0 * uncertainty > finding.goal.position_tolerance:
            reason += f'; the frozen position is known to +-{uncertainty:.2g} m at the tool only'
        if visit is None:
            reason += '; not visited'
    else:
        margin = finding.miss
    return GoalOutcome(
        finding.goal,
        finding.index,
        finding.outcome,
        relaxation,
        reason,
        *errors,
        uncertainty,
        margin,
        finding.relaxed,
        visit.posture if visit else None,
        visit.arrival if visit else float('nan'),
    )


def describe(outcomes: Sequence[GoalOutcome], why_not: str) -> tuple[PlanStatus, str]:
    """Status of a plan, and one sentence; ``why_not`` says why nothing is visited, if so."""
    total = len(outcomes)
    visited = sum(outcome.has_posture for outcome in outcomes)
    if total and visited == total:
        return PlanStatus.FINISHES, f'all {total} remaining goals are visited'
    if total == 0:
        return PlanStatus.FINISHES, 'no goals remain'
    parts = []
    for kind in (Outcome.LOST, Outcome.UNDECIDED, Outcome.RELAXED, Outcome.REACHABLE):
        names = [
            outcome.goal.id or f'goal {outcome.index}'
            for outcome in outcomes
            if outcome.outcome == kind and not outcome.has_posture
        ]
        if names:
            parts.append(f'{kind.value}: {", ".join(names)}')
    left = '; '.join(parts)
    if visited:
        return PlanStatus.PARTIAL, f'{visited} of {total} remaining goals are visited; {left}'
    return PlanStatus.HALTED, f'stands still: {why_not or "no goal can be visited"}; {left}'
