"""The motion of the healthy joints: to each chosen goal in turn with a rest there, or a stop."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.planning import timing
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.finding import Finding
from ft_manip_ros.core.planning.limits import MotionLimits, folded, travel
from ft_manip_ros.core.planning.lines import Lines
from ft_manip_ros.core.planning.margins import posture_margins
from ft_manip_ros.core.planning.move_times import straight_time
from ft_manip_ros.core.planning.moves import Moves
from ft_manip_ros.core.planning.ordering import fastest_order, safest_order
from ft_manip_ros.core.planning.settings import Order, PlanSettings
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
    groups = _folded_groups(findings, here, healthy, hard)
    if not lines:
        findings, groups = _ordered(chain, findings, groups, here, healthy, scaled, settings)
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
        return _first_times(moves.group(goal), q, v, here[healthy], scaled, hard, halt)

    def extra(goal: int) -> Array:
        if settings.limit_weight == 0.0:
            return np.zeros(len(moves.group(goal)))
        return settings.limit_weight * limit_closeness(moves.group(goal), scaled)

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


def _folded_groups(
    findings: Sequence[Finding], here: Array, healthy: NDArray[np.intp], limits: MotionLimits
) -> list[Array]:
    """Postures of the healthy joints, (K, m), for each goal, in the turns nearest to ``here``."""
    postures = [finding.postures.q for finding in findings]
    together = folded(np.concatenate(postures)[:, healthy], here[healthy], limits)
    return np.split(together, np.cumsum([len(q) for q in postures])[:-1])


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


def _first_times(
    group: Array,
    q: Array,
    v: Array,
    rest: Array,
    limits: MotionLimits,
    braking: MotionLimits,
    halt: Motion | None,
) -> Array:
    """Time (s) from the moving state to each posture, (K, m); straight after a stop if any."""
    if halt is None:
        return timing.arrival_times(q, v, group, limits, braking)
    rates = (limits.unlimited, limits.velocity, limits.acceleration, limits.jerk)
    return np.array([halt.duration + straight_time(rest, target, *rates) for target in group])


def _ordered(
    chain: SerialChain,
    findings: Sequence[Finding],
    groups: list[Array],
    here: Array,
    healthy: NDArray[np.intp],
    limits: MotionLimits,
    settings: PlanSettings,
) -> tuple[Sequence[Finding], list[Array]]:
    """Goals and their postures in the order that the settings ask for."""
    if settings.order == Order.GIVEN or len(findings) < 2:
        return findings, groups
    if settings.order == Order.SAFEST:
        names = {chain.joint_names[i] for i in range(chain.n)} - {
            chain.joint_names[i] for i in healthy
        }
        margins = [posture_margins(chain, finding.postures.q, names).max() for finding in findings]
        order = safest_order(np.array(margins))
    else:
        rates = (limits.unlimited, limits.velocity, limits.acceleration, limits.jerk)
        first = [min(straight_time(here[healthy], q, *rates) for q in group) for group in groups]
        order = fastest_order(np.array(first), groups, limits)
    return [findings[k] for k in order], [groups[k] for k in order]


def limit_closeness(postures: Array, limits: MotionLimits) -> Array:
    """From 0 (each joint in the middle of its range) to 1 (one at its end), shape (K,)."""
    middle = 0.5 * (limits.lower + limits.upper)
    off = np.abs(postures - middle) / (0.5 * (limits.upper - limits.lower))
    return np.max(np.where(limits.unlimited, 0.0, off), axis=1, initial=0.0)
