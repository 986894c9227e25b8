"""Independent check of FTWS certificates, in plain NumPy.

Shares no code with the engine, and uses weaker but simpler mathematics: straight families of
postures with the second derivative at their centre and a bound of the third, and branch and
bound by gradients.
What the certificate gives are only starting points: boxes that are too wide for the simple
bound are halved and their postures corrected here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ft_manip_ros.core.ftws.verifier_arm import Arm, Array

_DEPTH = 16
_BALLS = 14
_ROUNDING = 1e-11
# Boxes reach this far into each other (rad or m), lest rounding part them.
_OVERLAP = 1e-12
# How far (rad or m) postures of halved boxes start from the limits.
_INSET = 5e-3
_BATCH = 4096
# Pieces taken at once, and boxes of them at once before the rest counts as not proved.
_CHUNK = 256
_MOST_BOXES = 30_000


class NotConfirmedError(Exception):
    """A claim of the certificate that this verifier could not confirm; says which."""


def check_goal(arm: Arm, goal: Mapping[str, Any], budget: int = 2_000_000) -> str:
    """Check one goal of a certificate.

    Returns
    -------
    str
        What was confirmed.

    Raises
    ------
    NotConfirmedError
        If a claim is wrong or could not be confirmed.
    """
    verdict = goal['verdict']
    if verdict == 'undecided':
        return 'claims nothing'
    target = arm.goal(goal['point'], goal.get('orientation'))
    if verdict == 'non_member':
        at = {arm.index(name): a for name, a in zip(goal['joints'], goal['angles'], strict=True)}
        return _check_lost(arm, target, at, float(goal['residual']), budget)
    if verdict != 'member':
        raise NotConfirmedError(f'verdict {verdict!r} is not one of member, non_member, undecided')
    proved = 0
    for combo in arm.combos(int(goal['order'])):
        named = [arm.names[j] for j in combo]
        pieces = [piece for piece in goal['pieces'] if piece['joints'] == named]
        low = np.array([arm.operating[0, j] for j in combo])
        high = np.array([arm.operating[1, j] for j in combo])
        q = np.array([piece['posture'] for piece in pieces], float).reshape(-1, arm.n)
        half = np.array([piece['half'] for piece in pieces], float).reshape(-1, len(combo))
        boxes = []
        for i in range(0, len(q), _CHUNK):
            boxes += _proved(arm, target, combo, q[i : i + _CHUNK], half[i : i + _CHUNK])
        boxes.sort(key=lambda box: tuple(box[0]))
        left = uncovered(low, high, boxes)
        if left is not None:
            names = ', '.join(named)
            raise NotConfirmedError(f'{names} at {left.round(6).tolist()} is covered by no proof')
        proved += len(boxes)
    return f'{proved} proved boxes cover every combination'


def uncovered(low: Array, high: Array, boxes: list[tuple[Array, Array]]) -> Array | None:
    """Return a point of the box [low, high] outside the union of ``boxes``, or None."""
    stack = [(low, high, 0)]
    while stack:
        a, b, first = stack.pop()
        for i in range(first, len(boxes)):
            c, d = boxes[i]
            if (c > b).any() or (d < a).any() or ((d <= a) & (a < b)).any():
                continue
            # Cut off what sticks out of box i on each side; the rest of [a, b] lies in it.
            a, b = a.copy(), b.copy()
            for j in range(len(a)):
                if a[j] < c[j]:
                    upper = b.copy()
                    upper[j] = c[j]
                    stack.append((a.copy(), upper, i + 1))
                    a[j] = c[j]
                if b[j] > d[j]:
                    lower = a.copy()
                    lower[j] = d[j]
                    stack.append((lower, b.copy(), i + 1))
                    b[j] = d[j]
            break
        else:
            return 0.5 * (a + b)
    return None


def _proved(
    arm: Arm, target: Array, combo: list[int], q: Array, half: Array
) -> list[tuple[Array, Array]]:
    """Prove postures within the limits over boxes of frozen positions, halving them as needed.

    ``q`` (N, n) are postures at the boxes' centres, ``half`` (N, k) their half-widths. Returns
    the ends of the boxes that were proved: pieces overlap, so some may fail.
    """
    boxes: list[tuple[Array, Array]] = []
    half = half + _OVERLAP
    free = [i for i in range(arm.n) if i not in combo]
    inset = np.where(arm.wraps, -np.inf, np.minimum(_INSET, 0.25 * (arm.upper - arm.lower)))
    low, high = (arm.lower + inset)[free], (arm.upper - inset)[free]
    for _ in range(_DEPTH + 1):
        if not len(q) or len(q) > _MOST_BOXES:
            break
        q = arm.correct(q, free, target)
        residual = arm.residuals(q, target)
        jacobian, distance, axes, linear = arm.jacobians(q, target)
        start = np.linalg.norm(residual, axis=1) + _ROUNDING
        part = jacobian[:, :, free]
        inverse = arm.inverse(part, q[:, free], free)
        tangent = np.zeros((len(q), arm.n, len(combo)))
        tangent[:, free] = -inverse @ jacobian[:, :, combo]
        for column, joint in enumerate(combo):
            tangent[:, joint, column] = 1.0
        along = np.einsum('nik,nk->ni', np.abs(tangent), half)
        missed = (np.linalg.norm(jacobian @ tangent, axis=1) * half).sum(axis=1)
        gain = np.zeros((len(q), arm.n))
        gain[:, free] = np.linalg.norm(inverse, axis=2)
        second = _second_order(arm.hessians(axes, linear), tangent, inverse, free, half)
        defect = np.linalg.norm(part @ inverse - np.eye(part.shape[1]), axis=(1, 2))
        slack = np.where(arm.wraps, np.inf, np.minimum(q - arm.lower, arm.upper - q))
        slack[:, combo] = np.inf
        proved = np.zeros(len(q), dtype=bool)
        rho = np.zeros(len(q))
        for ball in range(_BALLS):
            v = along + gain * rho[:, None]
            bend = second[0] + rho * (second[1] + rho * second[2])
            error = start + missed + defect * rho + arm.remainder(distance, v, bend)
            error *= 1.0 + 1e-9
            # Without a ball nothing is corrected, but the posture may be near enough as it is.
            allowed = arm.tolerance if ball == 0 else rho
            proved |= (error <= allowed) & (v <= slack).all(axis=1)
            rho = np.maximum(2.0 * start, 1e-9) if ball == 0 else 2.5 * rho
        done = q[proved][:, combo]
        boxes += zip(done - half[proved], done + half[proved], strict=True)
        q, half, tangent = q[~proved], half[~proved], tangent[~proved]
        rows = np.arange(len(q))
        side = np.argmax(half, axis=1)
        half = half.copy()
        half[rows, side] *= 0.5
        step = half[rows, side][:, None] * tangent[rows, :, side]
        half[rows, side] += _OVERLAP
        q, half = np.concatenate([q - step, q + step]), np.concatenate([half, half])
        # Off the limits, where the self-motion allows it: at one, no box is admissible.
        q[:, free] = np.clip(q[:, free], low, high)
    return boxes


def _second_order(
    hessian: Array, tangent: Array, inverse: Array, free: list[int], half: Array
) -> tuple[Array, Array, Array]:
    """Bounds of |H[d, d]| for d = tangents within the box plus inverse times a ball.

    Returns the coefficients (N,) of the ball's radius to the powers 0, 1 and 2.
    """
    bent = np.einsum('nrij,njk->nrik', hessian, tangent)
    pairs = np.linalg.norm(np.einsum('nrik,nil->nrkl', bent, tangent), axis=1)
    mixed = np.linalg.norm(np.einsum('nrik,nia->nrka', bent[:, :, free], inverse), axis=(1, 3))
    part = np.einsum('nrij,nja->nria', hessian[:, :, free][:, :, :, free], inverse)
    square = np.einsum('nria,nib->nrab', part, inverse)
    return (
        np.einsum('nkl,nk,nl->n', pairs, half, half),
        2.0 * (mixed * half).sum(axis=1),
        np.sqrt((square**2).sum(axis=(1, 2, 3))),
    )


def _check_lost(
    arm: Arm, target: Array, at: dict[int, float], distance: float, budget: int
) -> str:
    """Confirm by branch and bound that no posture with joints frozen ``at`` reaches the goal."""
    for joint, angle in at.items():
        if not arm.operating[0, joint] - 1e-9 <= angle <= arm.operating[1, joint] + 1e-9:
            raise NotConfirmedError(f'{arm.names[joint]} cannot freeze at {angle}')
    if arm.plane_distance(target) > arm.tolerance:
        return 'the goal is off the plane of the arm'
    free = [i for i in range(arm.n) if i not in at]
    centres = 0.5 * (arm.lower + arm.upper)[None, :]
    halves = 0.5 * (arm.upper - arm.lower)[None, :]
    for joint, angle in at.items():
        centres[:, joint], halves[:, joint] = angle, 0.0
    # Prove a little less than was claimed, but more than the tolerance.
    needed = arm.tolerance + 0.1 * max(distance - arm.tolerance, 0.0)
    aim: Array | None = None
    smallest = np.inf
    spent = 0
    while len(centres):
        taken, centres = centres[-_BATCH:], centres[:-_BATCH]
        widths, halves = halves[-_BATCH:], halves[:-_BATCH]
        spent += len(taken)
        if spent > budget:
            raise NotConfirmedError(f'not refuted within {budget} boxes')
        residuals = arm.residuals(taken, target)
        norms = np.linalg.norm(residuals, axis=1)
        nearest = int(np.argmin(norms))
        if norms[nearest] < 0.9 * smallest:
            q = arm.descend(taken[nearest], free, target)
            residual = arm.residuals(q[None], target)[0]
            smallest = min(smallest, float(np.linalg.norm(residual)), norms[nearest])
            if smallest <= arm.tolerance:
                raise NotConfirmedError(f'a posture reaches the goal to {smallest:.3g} m')
            aim = residual / np.linalg.norm(residual)
        bounds, cost = arm.lower_bounds(taken, widths, residuals, target, aim)
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
    return f'refuted again with {spent} boxes'
