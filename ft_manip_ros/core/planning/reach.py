"""Cheap proofs that a goal is out of reach: bounds on the distance from base to tool."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.kinematics import fk


def proved_miss(rod: SerialChain, goal: Goal) -> tuple[float, str]:
    """Distance (m) by which a ROD is proved to miss a goal's position, and why; 0 if not proved.

    The way from the first joint to the tool is a sum of vectors of known length (a prismatic
    joint's is known within a range), so by the triangle inequality its length lies between the
    longest one less all others and the sum of all.

    Parameters
    ----------
    rod
        The arm with its frozen joints part of the placements.
    """
    if rod.n == 0:
        _, tool = fk(rod, np.empty(0))
        return float(np.linalg.norm(tool - goal.position)), 'no joint is left to move'
    base, low, high = _parts(rod)
    asked = math.dist(goal.position.tolist(), base)
    furthest = sum(high)
    if asked > furthest:
        return asked - furthest, f'it is {asked:.3f} m away, the arm spans {furthest:.3f} m'
    k = low.index(max(low))
    nearest = low[k] - (furthest - high[k])
    if asked < nearest:
        why = f'it is {asked:.3f} m away, the arm cannot fold below {nearest:.3f} m'
        return nearest - asked, why
    return 0.0, ''


@lru_cache(maxsize=8)
def _parts(rod: SerialChain) -> tuple[list[float], list[float], list[float]]:
    """Place of the first joint, then the least and the largest length of every part of the way."""
    # What no arm with free axes reaches is out of reach for one whose axes move together.
    rod = rod.uncoupled
    low = [float(length) for length in np.linalg.norm(rod.translations[1:], axis=1)]
    high = list(low)
    for joint in rod.joints:
        if joint.prismatic:
            ends = (abs(joint.lower), abs(joint.upper))
            crosses = joint.lower < 0.0 < joint.upper
            low.append(0.0 if crosses else min(ends))
            high.append(max(ends))
    return rod.translations[0].tolist(), low, high
