"""From findings and the motion to the outcome of each goal, in numbers and words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.kinematics import fk, jacobian
from ft_manip_ros.core.planning.plan import GoalOutcome, Outcome, PlanStatus
from ft_manip_ros.core.planning.route import Visit
from ft_manip_ros.core.planning.triage import Finding


def tool_errors(chain: SerialChain, q: Array, goal: Goal) -> tuple[float, float]:
    """Distance (m) and angle (rad) between the tool at posture ``q``, (n,), and a goal.

    The angle is that between the z axes where the goal leaves the roll free, and NaN where it
    has no orientation.
    """
    rotation, position = fk(chain, q)
    distance = float(np.linalg.norm(position - goal.position))
    if goal.orientation is None:
        return distance, float('nan')
    if goal.free_axis:
        a, b = rotation[:, 2], goal.orientation[:, 2]
        return distance, float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
    turn = goal.orientation @ rotation.T
    skew = 0.5 * (turn - turn.T)
    sine = np.linalg.norm([skew[2, 1], skew[0, 2], skew[1, 0]])
    return distance, float(np.arctan2(sine, 0.5 * (np.trace(turn) - 1.0)))


def tool_uncertainty(chain: SerialChain, q: Array, sigma: Mapping[str, float]) -> float:
    """Standard deviation (m) of the tool position that the frozen joints' sigmas cause."""
    if not any(sigma.values()):
        return 0.0
    moves = jacobian(chain, q)[:3]
    variance = sum(
        float(np.sum(moves[:, chain.index(name)] ** 2)) * value**2 for name, value in sigma.items()
    )
    return float(np.sqrt(variance))


def posture_margin(chain: SerialChain, q: Array, frozen: Mapping[str, float]) -> float:
    """Distance (m) that the tool could move any way before a healthy joint meets its limit.

    To first order, by the smallest joint motion; 0 at a singular posture.
    """
    healthy = [i for i, name in enumerate(chain.joint_names) if name not in frozen]
    moves = jacobian(chain, q)[:3, healthy]
    if np.linalg.matrix_rank(moves) < 3:
        return 0.0
    effort = np.linalg.norm(np.linalg.pinv(moves), axis=1)
    slack = np.minimum(q - chain.lower, chain.upper - q)[healthy]
    slack = np.where(chain.arrays.wraps[healthy], np.inf, np.maximum(slack, 0.0))
    return float(np.min(slack / np.maximum(effort, 1e-12)))


def outcome_of(
    chain: SerialChain,
    finding: Finding,
    visit: Visit | None,
    frozen: Mapping[str, float],
    sigma: Mapping[str, float],
) -> GoalOutcome:
    """Outcome of one goal; ``visit`` is None where the motion does not go there."""
    relaxation = '' if finding.relaxation is None else finding.relaxation.value
    found = finding.postures
    q = visit.posture if visit else (found.q[0] if len(found.q) else found.best)
    position_error, orientation_error = tool_errors(chain, q, finding.relaxed)
    margin = finding.miss
    uncertainty = tool_uncertainty(chain, q, sigma)
    reason = finding.reason
    if len(found.q):
        margin = posture_margin(chain, q, frozen)
        if 2.0 * uncertainty > finding.goal.position_tolerance:
            reason += f'; the frozen position is known to +-{uncertainty:.2g} m at the tool only'
        if visit is None:
            reason += '; not visited'
    return GoalOutcome(
        finding.goal,
        finding.index,
        finding.outcome,
        relaxation,
        reason,
        position_error,
        orientation_error,
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
