"""What a degraded arm can still do with each goal; a failed search alone never loses one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays, SerialChain
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.finding import Finding
from ft_manip_ros.core.planning.plan import Outcome
from ft_manip_ros.core.planning.postures import Postures, find_postures
from ft_manip_ros.core.planning.reach import proved_miss
from ft_manip_ros.core.planning.settings import PlanSettings, Relaxation

# How much longer to look for postures of a goal when those found touch or lead nowhere, and what
# tells the random starts of that search from those of the first.
_PATIENCE = (4, 32)
_OTHER_SEED = 1_000_003


def relaxations(goal: Goal) -> list[tuple[Relaxation, Goal]]:
    """Weaker goals, the least given up first."""
    if goal.orientation is None:
        return []
    weaker = []
    if not goal.free_axis:
        weaker.append((Relaxation.FREE_ROLL, replace(goal, free_axis=True)))
    dropped = replace(goal, orientation=None, free_axis=False)
    weaker.append((Relaxation.ORIENTATION_DROPPED, dropped))
    return weaker


def triage(
    chain: ChainArrays,
    rod: SerialChain,
    frozen: NDArray[np.bool_],
    goals: Sequence[tuple[int, Goal]],
    here: Array,
    settings: PlanSettings,
    hints: Mapping[int, Array],
    blur: float,
    checker: CollisionChecker | None = None,
) -> list[Finding]:
    """Judge goals in order; each search starts from the postures found for the goal before.

    Parameters
    ----------
    chain
        The full arm with the limits to obey.
    rod
        The same arm with its frozen joints taken out; with nothing frozen, the arm.
    frozen : shape (n,)
    goals
        With their places in the original task.
    here : shape (n,)
        Where the arm stands, or will once it has stopped.
    hints
        Postures, (n,), to start from besides others, by place of the goal.
    blur
        How far (m) the frozen joints' uncertain positions may displace the tool.
    checker
        Of bodies that must not touch; None where they are not known.
    """
    near = here[None, :]
    findings = []
    for index, goal in goals:
        starts = np.vstack([near, hints[index]]) if index in hints else near
        finding = _judge(chain, rod, frozen, index, goal, starts, settings, blur)
        if checker is not None:
            finding = _without_touching(chain, frozen, finding, here, settings, checker)
        findings.append(finding)
        if len(finding.postures.q):
            near = np.vstack([finding.postures.q[: settings.postures // 2 + 1], here])
    return findings


def _judge(
    chain: ChainArrays,
    rod: SerialChain,
    frozen: NDArray[np.bool_],
    index: int,
    goal: Goal,
    near: Array,
    settings: PlanSettings,
    blur: float,
) -> Finding:
    miss, why = proved_miss(rod, goal)
    miss -= blur
    if miss > goal.position_tolerance:
        nothing = Postures(np.empty((0, len(frozen))), near[0], miss, np.nan)
        return Finding(goal, index, Outcome.LOST, goal, None, nothing, why, miss)
    asked = find_postures(chain, frozen, goal, near, settings, seed=settings.seed + index)
    if len(asked.q):
        return Finding(goal, index, Outcome.REACHABLE, goal, None, asked, _reached(asked))
    for relaxation, weaker in relaxations(goal):
        found = find_postures(chain, frozen, weaker, near, settings, seed=settings.seed + index)
        if len(found.q):
            reason = f'with the {relaxation.value} only: {_missed(asked, goal)}'
            return Finding(goal, index, Outcome.RELAXED, weaker, relaxation, found, reason)
    reason = f'neither posture nor proof: {_missed(asked, goal)}'
    return Finding(goal, index, Outcome.UNDECIDED, goal, None, asked, reason)


def further_postures(
    chain: ChainArrays,
    frozen: NDArray[np.bool_],
    finding: Finding,
    here: Array,
    settings: PlanSettings,
    checker: CollisionChecker,
) -> Array:
    """Look longer for postures, (K, n), of a goal, and return those in which nothing touches.

    Those of the finding may be among them. Parameters as for `triage`.
    """
    free = np.empty((0, len(here)))
    for patience in _PATIENCE:
        patient = replace(
            settings,
            postures=patience * settings.postures,
            attempts=patience * settings.attempts,
        )
        seed = settings.seed + finding.index + _OTHER_SEED * patience
        found = find_postures(chain, frozen, finding.relaxed, here[None, :], patient, seed=seed)
        free = np.array([q for q in found.q if not checker.touches(q)]).reshape(-1, len(here))
        if len(free):
            break
    return free


def _without_touching(
    chain: ChainArrays,
    frozen: NDArray[np.bool_],
    finding: Finding,
    here: Array,
    settings: PlanSettings,
    checker: CollisionChecker,
) -> Finding:
    """Drop the postures in which bodies touch; without any others either the goal is open."""
    found = finding.postures
    free = np.array([not checker.touches(q) for q in found.q], dtype=bool)
    if free.all():
        return finding
    kept = replace(found, q=found.q[free])
    if not len(kept.q):
        kept = replace(found, q=further_postures(chain, frozen, finding, here, settings, checker))
    if len(kept.q):
        return replace(finding, postures=kept, reason=_reached(kept))
    reason = f'{checker.what_touches(found.q[0])}, as bodies do in every other posture found'
    return finding.without_postures(reason)


def _reached(found: Postures) -> str:
    count = len(found.q)
    return f'{count} posture{"s" if count > 1 else ""} found'


def _missed(best: Postures, goal: Goal) -> str:
    turn = ''
    if goal.orientation is not None:
        turn = f' and {best.orientation_error:.3g} rad'
    return f'the best posture found as asked misses by {best.position_error:.3g} m{turn}'
