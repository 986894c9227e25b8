"""Planar arms without limits: the exact FTWS of any order, and the 2k theorem (section 3)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from ft_manip_ros.core.errors import InputError


def planar_ftws(lengths: Sequence[float], order: int = 1) -> list[tuple[float, float]]:
    """Exact k-th order FTWS of a planar positional arm without limits, as intervals of radius.

    Joints frozen side by side make their links one rigid group whose length can be anything
    between what folding and stretching give; a group that contains joint 1 only shifts the base
    of the rest, by its length in any direction. So every ROD is an annulus, and the worst
    lengths are at the ends of the groups' ranges. For unit links this gives the disc of radius
    2 for 2k + 2 of them and the circle r = 1 for 2k + 1.

    Parameters
    ----------
    lengths
        Of the n links (m), >= 0.
    order
        k, 1 to n - 1.

    Returns
    -------
    list of (float, float)
        Radii (m) [inner, outer], sorted; empty if there is no such place. The paper's annulus
        where there is one interval.

    Raises
    ------
    InputError
        For lengths that are negative or not finite, or an impossible order.
    """
    links = np.array(lengths, dtype=float)
    if links.ndim != 1 or len(links) < 2 or not np.isfinite(links).all() or (links < 0.0).any():
        raise InputError('lengths', 'must be at least two finite numbers >= 0 (m)')
    if not 1 <= order < len(links):
        raise InputError('order', f'is {order}; must be 1 to {len(links) - 1}')
    intervals = [(0.0, float(links.sum()))]
    for frozen in combinations(range(len(links)), order):
        base, groups = _groups(links, set(frozen))
        shortest = sum(low for low, _ in groups)
        inner = max([high - (shortest - low) for low, high in groups] + [0.0])
        intervals = _cut(intervals, 0.0, shortest - base[1])
        if inner > 0.0:
            # Every distance from the shifted base has to clear the hole.
            intervals = _cut(intervals, 0.0, base[0] - inner) + _cut(
                intervals, base[1] + inner, np.inf
            )
    return sorted(set(intervals))


def _groups(
    links: np.ndarray, frozen: set[int]
) -> tuple[tuple[float, float], list[tuple[float, float]]]:
    """Length ranges of the rigid group at the base (0, 0: none) and of the moving groups."""
    runs: list[list[float]] = [[]]
    for i, length in enumerate(links):
        if i not in frozen:
            runs.append([])
        runs[-1].append(float(length))
    ranges = [
        (max(0.0, 2.0 * max(run) - sum(run)), sum(run)) if run else (0.0, 0.0) for run in runs
    ]
    return ranges[0], ranges[1:]


def _cut(
    intervals: list[tuple[float, float]], low: float, high: float
) -> list[tuple[float, float]]:
    """Intervals within [low, high]."""
    cut = [(max(a, low), min(b, high)) for a, b in intervals]
    # Touching by rounding counts as touching: the circle of the 3R arm is a single radius.
    return [(a, max(a, b)) for a, b in cut if b >= a - 1e-12]


def degrees_of_freedom(order: int, orientation: bool = False) -> int:
    """Joints necessary and sufficient for a planar arm to be k-fault tolerant (the 2k theorem).

    2k more than the task needs: 2k + 2 for positions, 2k + 3 with orientation.

    Raises
    ------
    InputError
        For a negative order.
    """
    if order < 0:
        raise InputError('order', f'is {order}; must be >= 0')
    return 2 * order + (3 if orientation else 2)


def reduce_pose(
    lengths: Sequence[float], pose: tuple[float, float, float]
) -> tuple[list[float], tuple[float, float]]:
    """Turn a planar pose into a position of the arm without its last link (section 3.4).

    The arm is k-FT for the pose exactly if the shorter arm is k-FT for the position and
    (k-1)-FT for it in any direction.

    Parameters
    ----------
    lengths
        Of the n links (m).
    pose
        x, y (m) and phi (rad).

    Returns
    -------
    lengths : list of float
        The first n - 1.
    position : (float, float)
        ``(x - l_n cos phi, y - l_n sin phi)`` (m).
    """
    x, y, phi = pose
    last = float(lengths[-1])
    return [float(v) for v in lengths[:-1]], (x - last * np.cos(phi), y - last * np.sin(phi))
