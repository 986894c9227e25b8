"""Proof by branch and bound that no posture with joints frozen as said comes near a goal."""

from __future__ import annotations

import numpy as np

from ft_manip_ros.core.ftws.verifier_arm import Arm, Array
from ft_manip_ros.core.ftws.verifier_postures import descend

# Boxes of postures bounded at once.
_BATCH = 4096
# What of the claimed distance beyond the least is proved: more boxes for more.
_SHARE = 0.1


class NotLostError(Exception):
    """The goal is reached after all, or the budget is spent; says which."""


def prove_lost(
    arm: Arm, target: Array, at: dict[int, float], distance: float, least: float, budget: int
) -> int:
    """Prove that no posture with joints frozen ``at`` comes within ``least`` (m) of a goal.

    Parameters
    ----------
    distance
        What the certificate claims instead (m); a little less than it is proved.
    budget
        Boxes of postures to bound.

    Returns
    -------
    int
        Boxes bounded.

    Raises
    ------
    NotLostError
        With the reason, where that is not proved.
    """
    free = [i for i in range(arm.n) if i not in at]
    centres = 0.5 * (arm.lower + arm.upper)[None, :]
    halves = 0.5 * (arm.upper - arm.lower)[None, :]
    for joint, angle in at.items():
        centres[:, joint], halves[:, joint] = angle, 0.0
    needed = least + _SHARE * max(distance - least, 0.0)
    aim: Array | None = None
    smallest = np.inf
    spent = 0
    while len(centres):
        taken, centres = centres[-_BATCH:], centres[:-_BATCH]
        widths, halves = halves[-_BATCH:], halves[:-_BATCH]
        spent += len(taken)
        if spent > budget:
            raise NotLostError(f'not refuted within {budget} boxes')
        norms = np.linalg.norm(arm.residuals(taken, target), axis=1)
        nearest = int(np.argmin(norms))
        if norms[nearest] < 0.9 * smallest:
            q = descend(arm, taken[nearest], free, target)
            residual = arm.residuals(q[None], target)[0]
            smallest = min(smallest, float(np.linalg.norm(residual)), norms[nearest])
            if smallest <= least:
                raise NotLostError(f'a posture reaches the goal to {smallest:.3g} m')
            aim = residual / np.linalg.norm(residual)
        bounds, cost = lower_bounds(arm, taken, widths, target, aim)
        left = bounds <= needed
        taken, widths, cost = taken[left], widths[left], cost[left]
        side = np.argmax(cost, axis=1)
        rows = np.arange(len(taken))
        widths[rows, side] *= 0.5
        for sign in (-1.0, 1.0):
            moved = taken.copy()
            moved[rows, side] += sign * widths[rows, side]
            centres = np.concatenate([centres, moved])
            halves = np.concatenate([halves, widths])
    return spent


def lower_bounds(
    arm: Arm, q: Array, half: Array, target: Array, aim: Array | None
) -> tuple[Array, Array]:
    """Lower bounds of the residual over boxes of postures.

    ``|F| >= u . F`` for every unit vector u, and that is bounded joint by joint from its first
    and second derivatives at the box's centre and a bound of the third.

    Parameters
    ----------
    q, half : shape (N, n)
        Centres and half-widths.
    aim : shape (m,) or None
        A direction u to try beside each residual's own.

    Returns
    -------
    bounds : shape (N,)
        m.
    cost : shape (N, n)
        What each joint's width costs the bound, about: where to cut.
    """
    at = arm.derivatives(q, target)
    norms = np.linalg.norm(at.residual, axis=1)
    second, third = arm.second_bound(at.distance, half), arm.third_bound(at.distance, half)
    best = np.full(len(q), -np.inf)
    directions = [at.residual / np.maximum(norms, 1e-300)[:, None]]
    if aim is not None:
        directions.append(np.broadcast_to(aim, at.residual.shape))
    for u in directions:
        value = (u * at.residual).sum(axis=1)
        slope = np.abs(np.einsum('nr,nri->ni', u, at.jacobian)) * half
        curve = np.einsum('nr,nrik->nik', u, at.hessian)
        own = np.einsum('nii->ni', curve) * half**2
        off = np.abs(curve) * half[:, :, None] * half[:, None, :]
        mixed = 0.5 * (off.sum(axis=(1, 2)) - np.einsum('nii->n', off))
        # The least of  slope t + own t^2 / 2  for |t| <= 1: inside where it turns there.
        least = -slope + 0.5 * own
        turning = (own > 0.0) & (slope < own)
        least[turning] = -0.5 * slope[turning] ** 2 / own[turning]
        curved = value + least.sum(axis=1) - mixed - third / 6.0
        straight = value - slope.sum(axis=1) - 0.5 * second
        best = np.maximum(best, np.maximum(curved, straight))
    turned = np.where(arm.prismatic, at.distance, np.hypot(at.distance, arm.length))
    return best * (1.0 - 1e-9) - 1e-11, half * np.maximum(turned, 1e-6)
