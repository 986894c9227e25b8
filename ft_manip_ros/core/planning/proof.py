"""After a plan has left: settle by proof which of its undecided goals are lost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.planning.limits import arrays_within, motion_limits
from ft_manip_ros.core.planning.plan import GoalOutcome, Outcome, Plan
from ft_manip_ros.core.planning.refutation import refute_goal
from ft_manip_ros.core.planning.reporting import describe
from ft_manip_ros.core.planning.settings import PlanSettings


@dataclass(frozen=True, eq=False)
class Proof:
    """What the branch and bound of all undecided goals of a plan came to.

    Attributes
    ----------
    plan
        The same plan with the goals that are proved lost called so; the motion is the same.
    found
        Postures, (n,), that turned up instead of a proof, by place of the goal: reason to plan
        again from them.
    """

    plan: Plan
    found: Mapping[int, Array] = field(default_factory=dict)


def needs_proof(plan: Plan) -> bool:
    """Tell whether `prove` could change anything."""
    return any(_open(outcome) for outcome in plan.outcomes)


def prove(chain: SerialChain, plan: Plan, settings: PlanSettings) -> Proof:
    """Try to refute every undecided goal; takes tens of milliseconds for each.

    Only the position is refuted, the weakest form of a goal: what has lost that has lost all.

    Parameters
    ----------
    chain
        The full arm.
    """
    limits = motion_limits(chain, operating=not plan.frozen, jerk_time=settings.jerk_time)
    arrays = arrays_within(chain, limits)
    found: dict[int, Array] = {}
    outcomes = []
    for outcome in plan.outcomes:
        if not _open(outcome):
            outcomes.append(outcome)
            continue
        place = replace(outcome.goal, orientation=None, free_axis=False)
        refutation = refute_goal(
            chain,
            arrays,
            place,
            frozen=plan.frozen,
            sigma=plan.sigma,
            position_error=outcome.position_error,
            orientation_error=0.0,
            boxes=settings.proof_boxes,
        )
        if refutation.posture is not None and outcome.goal.orientation is None:
            found[outcome.index] = refutation.posture
        outcomes.append(_lost(outcome, refutation.miss) if refutation.miss > 0.0 else outcome)
    done = tuple(outcomes)
    status, reason = describe(done, plan.why_not)
    if plan.trajectory is None:
        status, reason = plan.status, plan.reason
    return Proof(replace(plan, status=status, reason=reason, outcomes=done), found)


def _open(outcome: GoalOutcome) -> bool:
    """Tell whether no posture is known; one that is known may still touch something."""
    goal = outcome.goal
    reached = outcome.position_error <= goal.position_tolerance and not (
        outcome.orientation_error > goal.orientation_tolerance
    )
    return outcome.outcome == Outcome.UNDECIDED and not reached


def _lost(outcome: GoalOutcome, miss: float) -> GoalOutcome:
    reason = f'proved: no posture comes within {miss:.3g} m'
    return replace(outcome, outcome=Outcome.LOST, reason=reason, margin=miss)
