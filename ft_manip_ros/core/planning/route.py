"""The motion of the healthy joints: to each chosen goal in turn with a rest there, or a stop."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.planning import candidates, timing
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.finding import Finding
from ft_manip_ros.core.planning.limits import MotionLimits, folded, travel
from ft_manip_ros.core.planning.lines import Lines
from ft_manip_ros.core.planning.moves import Moves
from ft_manip_ros.core.planning.settings import PlanSettings
from ft_manip_ros.core.planning.timing import Motion
from ft_manip_ros.core.planning.way import WayFinder

# A controller needs two points; a stop that takes no time still stands for this long (s).
_SHORTEST_HOLD = 0.1
# Time between two looks at a stop, on which every joint goes its own way (s).
_LOOKS = 0.01


@dataclass(frozen=True, eq=False)
class Visit:
    """Arrival at one goal: s from the start, and the posture, (n,), of the full arm."""

    arrival: float
    posture: Array


@dataclass(frozen=True, eq=False)
class Route:
    """A motion of the healthy joints, and what it visits, by place in the original task.

    ``cut_off`` are the places of goals to which no way was found that touches nothing.
    ``stopped`` is when (s) the arm rests between a stop at the beginning and the first move;
    infinite where it flows on.
    """

    motion: Motion
    visits: dict[int, Visit] = field(default_factory=dict)
    cut_off: set[int] = field(default_factory=set)
    stopped: float = math.inf


def stop_route(q: Array, v: Array, limits: MotionLimits, settings: PlanSettings) -> Route:
    """Come to rest at once; q and v, (m,), are the state of the healthy joints."""
    parts = [timing.stop(q, v, limits, settings.sample_period)] if len(q) else []
    end = parts[-1].positions[-1] if parts else q
    return Route(timing.joined([*parts, timing.hold(end, _SHORTEST_HOLD)]))


def touch_while_stopping(
    q: Array,
    v: Array,
    healthy: NDArray[np.intp],
    here: Array,
    limits: MotionLimits,
    checker: CollisionChecker,
) -> str:
    """What touches on the way from the moving state, (m,) each, to rest; empty for nothing.

    Nothing stops the arm earlier than its limits allow, so this can only be told.
    """
    motion = timing.stop(q, v, limits, _LOOKS)
    positions = np.tile(here, (len(motion.times), 1))
    positions[:, healthy] = motion.positions
    since = checker.first_touch(motion.times, positions)
    if since is None:
        return ''
    later = positions[motion.times >= since]
    what = checker.what_touches(*later)
    return f'{what} while the arm stops, from t = {since:.2f} s on'


def plan_route(
    chain: SerialChain,
    findings: Sequence[Finding],
    lines: Lines,
    q: Array,
    v: Array,
    healthy: NDArray[np.intp],
    here: Array,
    limits: MotionLimits,
    settings: PlanSettings,
    checker: CollisionChecker | None,
    more: Callable[[Finding], Array],
) -> Route:
    """Visit the goals, each in the posture that makes the whole fastest.

    Parameters
    ----------
    chain
        The full arm.
    findings
        Goals with at least one posture each.
    lines
        Straight lines to those of them that ask for one; their order is then kept.
    q, v : shape (m,)
        State of the healthy joints.
    healthy : shape (m,)
        Their places in the full arm.
    here : shape (n,)
        Where the full arm would come to rest if it stopped at once.
    limits
        Of all n joints.
    checker
        Of bodies that must not touch; None where they are not known.
    more
        Function that looks for further postures, (K, n), of a goal to which those known lead by
        no way that touches nothing.
    """
    hard = limits.take(healthy)
    scaled = hard.scaled(settings.rate_scale)
    groups = candidates.folded_groups(findings, here, healthy, hard)
    if not lines:
        findings, groups = candidates.ordered(
            chain, findings, groups, here, healthy, scaled, settings
        )
    # Among bodies, and along a line, every move begins at rest: the arm stops first. Else it
    # flows on.
    stops = checker is not None or (bool(findings) and findings[0].index in lines)
    halt = stop_route(q, v, hard, settings).motion if stops else None
    straight = _line_motions(findings, lines, groups, here, healthy, scaled, settings)

    def first_times(goal: int) -> Array:
        if goal in straight:
            # Only that of the first goal begins where the arm stops.
            begin = np.inf if goal or halt is None else halt.duration
            return np.array([begin + move.duration for move in straight[goal].values()])
        return candidates.first_times(moves.group(goal), q, v, here[healthy], scaled, hard, halt)

    def extra(goal: int) -> Array:
        if settings.limit_weight == 0.0:
            return np.zeros(len(moves.group(goal)))
        return settings.limit_weight * candidates.limit_closeness(moves.group(goal), scaled)

    def others(goal: int) -> Array:
        return folded(more(findings[goal])[:, healthy], here[healthy], hard)

    moves = Moves(
        groups,
        scaled,
        here,
        healthy,
        checker,
        straight,
        checks=settings.detour_checks,
        seed=settings.seed,
    )
    way = WayFinder(moves, len(groups), first_times, extra, scaled, others).find()
    parts: list[Motion] = [] if halt is None else [halt]
    visits: dict[int, Visit] = {}
    at, clock = (q, 0.0) if halt is None else (halt.positions[-1], halt.duration)
    for place, (k, pick) in enumerate(zip(way.kept, way.picks, strict=True)):
        for target in [*way.vias.get(place, ()), moves.group(k)[pick]]:
            if k in straight:
                before = way.picks[place - 1] if place else 0
                move = straight[k][before, pick]
                move = replace(move, positions=move.positions + (at - move.positions[0]))
            elif parts:
                end = at + travel(at, target, scaled.unlimited)
                move = timing.move_between(at, end, scaled, settings.sample_period)
            else:
                move = timing.move_from(q, v, target, scaled, hard, settings.sample_period)
            at = move.positions[-1]
            clock += move.duration
            parts.append(move)
        posture = here.copy()
        posture[healthy] = at
        visits[findings[k].index] = Visit(clock, posture)
        parts.append(timing.hold(at, max(settings.dwell, timing.SHORTEST_STEP)))
        clock += parts[-1].duration
    cut_off = {finding.index for k, finding in enumerate(findings) if k not in way.kept}
    stopped = math.inf if halt is None else halt.duration
    return Route(timing.joined(parts), visits, cut_off, stopped)


def _line_motions(
    findings: Sequence[Finding],
    lines: Lines,
    groups: list[Array],
    here: Array,
    healthy: NDArray[np.intp],
    limits: MotionLimits,
    settings: PlanSettings,
) -> dict[int, dict[tuple[int, int], Motion]]:
    """By goal on the way, the motion from posture a of the goal before to its own posture b."""
    motions = {}
    for k, finding in enumerate(findings):
        if finding.index in lines:
            motions[k] = {
                (a, b): line.motion(line.start[healthy], healthy, limits, settings.sample_period)
                for b, (a, line) in enumerate(lines[finding.index])
            }
    return motions
