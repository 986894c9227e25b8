"""What a route chooses among: postures in the nearest turns, in which order, at what cost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.planning import timing
from ft_manip_ros.core.planning.finding import Finding
from ft_manip_ros.core.planning.limits import MotionLimits, folded
from ft_manip_ros.core.planning.margins import posture_margins
from ft_manip_ros.core.planning.move_times import straight_time
from ft_manip_ros.core.planning.ordering import fastest_order, safest_order
from ft_manip_ros.core.planning.settings import Order, PlanSettings
from ft_manip_ros.core.planning.timing import Motion


def folded_groups(
    findings: Sequence[Finding], here: Array, healthy: NDArray[np.intp], limits: MotionLimits
) -> list[Array]:
    """Postures of the healthy joints, (K, m), for each goal, in the turns nearest to ``here``."""
    postures = [finding.postures.q for finding in findings]
    together = folded(np.concatenate(postures)[:, healthy], here[healthy], limits)
    return np.split(together, np.cumsum([len(q) for q in postures])[:-1])


def ordered(
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


def first_times(
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


def limit_closeness(postures: Array, limits: MotionLimits) -> Array:
    """From 0 (each joint in the middle of its range) to 1 (one at its end), shape (K,)."""
    middle = 0.5 * (limits.lower + limits.upper)
    off = np.abs(postures - middle) / (0.5 * (limits.upper - limits.lower))
    return np.max(np.where(limits.unlimited, 0.0, off), axis=1, initial=0.0)
