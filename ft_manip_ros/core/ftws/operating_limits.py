"""Operating limits that make points order-1 members on arms whose strict FTWS is empty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import FtwsResult, Verdict
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.joint import Joint

Intervals = list[tuple[float, float]]

# Distance kept from the last frozen position at which a goal is reachable (rad or m).
_INSET = 2e-3


@dataclass(frozen=True)
class LimitsResult:
    """Operating limits for a set of goals.

    Attributes
    ----------
    chain
        The arm with the new operating limits; None if some joint has none.
    limits
        Per joint the widest interval (rad or m) at which every goal is proved reachable; None
        for a joint at which some goal is lost wherever it freezes.
    choices
        Per joint, all intervals at which every goal is proved reachable.
    verified
        The goals judged again under the new limits; empty without a chain.
    proved
        Every goal was proved a member under the new limits.
    reason
        In words.
    """

    chain: SerialChain | None
    limits: dict[str, tuple[float, float] | None]
    choices: dict[str, Intervals]
    verified: list[FtwsResult]
    proved: bool
    reason: str


def find_operating_limits(
    chain: SerialChain,
    goals: Sequence[Goal] | Array,
    *,
    mode: str = 'position',
    settings: FtwsSettings | None = None,
    threads: int = 1,
) -> LimitsResult:
    """Find the widest operating limits under which every goal is an order-1 member.

    After a failure the other joints use their physical limits, so where one joint may freeze
    does not depend on the operating limits of the others: each joint takes the widest interval
    common to the tolerated intervals of all goals. Exact up to the resolution of the covering.

    Parameters
    ----------
    chain
        The arm; the search starts from its physical limits.
    goals, mode, settings, threads
        As for `query.query`.
    """
    settings = replace(settings or FtwsSettings(), intervals=True)
    free = replace(
        chain,
        joints=tuple(
            replace(joint, operating_lower=None, operating_upper=None) for joint in chain.joints
        ),
    )
    choices: dict[str, Intervals] = {j.name: [(j.lower, j.upper)] for j in free.joints}
    for result in query(free, goals, mode=mode, settings=settings, threads=threads):
        for name in choices:
            choices[name] = intersect(choices[name], result.tolerated.get(name, []))
    limits: dict[str, tuple[float, float] | None] = {}
    for joint in free.joints:
        rows = choices[joint.name]
        limits[joint.name] = (
            _inset(max(rows, key=lambda row: row[1] - row[0]), joint) if rows else None
        )
    lost = [name for name, interval in limits.items() if interval is None]
    if lost:
        return LimitsResult(
            None, limits, choices, [], False,
            f'no operating limits exist: some goal is lost wherever {", ".join(lost)} freezes',
        )  # fmt: skip
    joints = []
    for joint in free.joints:
        interval = limits[joint.name]
        assert interval is not None
        joints.append(replace(joint, operating_lower=interval[0], operating_upper=interval[1]))
    limited = replace(free, joints=tuple(joints))
    verified = query(
        limited, goals, mode=mode, settings=replace(settings, intervals=False), threads=threads
    )
    proved = all(result.verdict is Verdict.MEMBER for result in verified)
    reason = 'every goal is a member' if proved else 'some goals could not be proved members'
    return LimitsResult(limited, limits, choices, verified, proved, reason)


def _inset(interval: tuple[float, float], joint: Joint) -> tuple[float, float]:
    """Step back from ends where a goal is only just reachable, but not from physical limits."""
    low, high = interval
    step = min(_INSET, 0.25 * (high - low))
    low = joint.lower if low <= joint.lower + 1e-9 else low + step
    high = joint.upper if high >= joint.upper - 1e-9 else high - step
    return low, high


def intersect(first: Intervals, second: Intervals) -> Intervals:
    """Intersection of two unions of intervals; single points are left out."""
    rows = []
    for a, b in first:
        for c, d in second:
            low, high = max(a, c), min(b, d)
            if high > low:
                rows.append((low, high))
    return sorted(rows)


def moveit_joint_limits(chain: SerialChain) -> dict[str, dict[str, dict[str, float | bool]]]:
    """Return the operating limits as MoveIt's ``joint_limits.yaml`` has them."""
    entries: dict[str, dict[str, float | bool]] = {}
    for joint in chain.joints:
        low, high = joint.operating
        entries[joint.name] = {
            'has_position_limits': True,
            'min_position': float(np.round(low, 9)),
            'max_position': float(np.round(high, 9)),
            'has_velocity_limits': True,
            'max_velocity': float(joint.velocity),
            'has_acceleration_limits': True,
            'max_acceleration': float(joint.acceleration),
        }
    return {'joint_limits': entries}
