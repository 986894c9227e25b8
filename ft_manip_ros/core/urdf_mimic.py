"""Mimic joints of a URDF: which joint moves each one, and what that leaves of its range."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import replace

from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.joint import Joint
from ft_manip_ros.core.urdf_text import some


def followed(
    joints: Mapping[str, ElementTree.Element], name: str, where: str
) -> tuple[str, float, float]:
    """Name of the joint that moves a joint, and the multiplier and offset of its motion.

    A joint that mimics one that mimics another follows the last of them. For a joint that moves
    on its own that is itself, 1 and 0.

    Parameters
    ----------
    joints
        All joint elements of the description, by name; Pinocchio has read their numbers.

    Raises
    ------
    InputError
        If a joint mimics one that does not exist, or, in the end, itself.
    """
    ratio, offset, seen = 1.0, 0.0, [name]
    while (mimic := joints[seen[-1]].find('mimic')) is not None:
        at = f'{where}: joint {seen[-1]!r}: mimic'
        leader = mimic.get('joint', '')
        if leader not in joints:
            raise InputError(at, f'names {leader!r}; joints: {some(list(joints))}')
        if leader in seen:
            raise InputError(at, f'goes round in a circle: {" -> ".join([*seen, leader])}')
        offset += ratio * float(mimic.get('offset', 0.0))
        ratio *= float(mimic.get('multiplier', 1.0))
        seen.append(leader)
    return seen[-1], ratio, offset


def tightened(
    leader: Joint, follower: Joint | float, ratio: float, offset: float, where: str
) -> Joint:
    """Return the leader with the range and the rates that its follower leaves it.

    Parameters
    ----------
    follower
        The joint that mimics it, with limits of its own; a number where these are equal, which
        is how a description says that it gives none.
    ratio, offset
        The follower stands at ``ratio * leader + offset``.

    Raises
    ------
    InputError
        If no position of the leader suits both.
    """
    if isinstance(follower, float):
        return leader
    velocity = min(leader.velocity, follower.velocity / abs(ratio))
    acceleration = min(leader.acceleration, follower.acceleration / abs(ratio))
    if follower.wraps:
        return replace(leader, velocity=velocity, acceleration=acceleration)

    def share(ends: tuple[float, float], own: tuple[float, float]) -> tuple[float, float]:
        low, high = sorted((end - offset) / ratio for end in ends)
        return max(own[0], low), min(own[1], high)

    lower, upper = share((follower.lower, follower.upper), (leader.lower, leader.upper))
    operating = share(follower.operating, leader.operating)
    if not (lower < upper and operating[0] <= operating[1]):
        raise InputError(
            where,
            f'has no range left: it mimics {leader.name!r}, which its own limits confine to '
            f'[{lower:g}, {upper:g}]',
        )
    narrower = operating != (lower, upper)
    return replace(
        leader,
        lower=lower,
        upper=upper,
        operating_lower=operating[0] if narrower else None,
        operating_upper=operating[1] if narrower else None,
        velocity=velocity,
        acceleration=acceleration,
    )
