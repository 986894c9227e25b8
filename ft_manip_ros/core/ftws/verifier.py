"""Independent check of FTWS certificates, in plain NumPy.

Shares no code with the engine but the chain's definition. What a certificate gives are hints:
postures to start from and boxes to try. A claim counts only as far as it is proved here again,
by the inequalities of `verifier_member` and `verifier_lost`, and only where what was proved
covers all of it (`verifier_cover`), or by those of polygons (`verifier_planar`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ft_manip_ros.core.ftws.verifier_arm import Arm, Array
from ft_manip_ros.core.ftws.verifier_cover import uncovered
from ft_manip_ros.core.ftws.verifier_lost import NotLostError, prove_lost
from ft_manip_ros.core.ftws.verifier_member import proved_boxes
from ft_manip_ros.core.ftws.verifier_planar import PLANAR, NotPlanarError, check_planar

# The kind of a proof that names none.
COVERING = 'covering'
# Cells of a volume that are this near (m) touch; far below the tolerance that goals are held to.
_TOUCHING = 1e-12


class NotConfirmedError(Exception):
    """A claim of the certificate that this verifier could not confirm; says which."""


def check_goal(arm: Arm, goal: Mapping[str, Any], budget: int = 5_000_000) -> str:
    """Check one goal of a certificate, with the ball of goals around it that it speaks of.

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
    radius = float(goal.get('radius', 0.0))
    if not radius >= 0.0:
        raise NotConfirmedError(f'radius {radius} is not a number >= 0')
    if verdict not in ('member', 'non_member'):
        raise NotConfirmedError(f'verdict {verdict!r} is not one of member, non_member, undecided')
    kind = goal.get('kind', COVERING)
    if kind == PLANAR:
        try:
            return check_planar(arm, goal, target, radius)
        except NotPlanarError as error:
            raise NotConfirmedError(str(error)) from None
    if kind != COVERING:
        raise NotConfirmedError(f'proof kind {kind!r} is not one of {COVERING}, {PLANAR}')
    if verdict == 'non_member':
        return _check_lost(arm, goal, target, radius, budget)
    return _check_member(arm, goal, target, radius)


def _check_member(arm: Arm, goal: Mapping[str, Any], target: Array, radius: float) -> str:
    if arm.plane_distance(target) > arm.tolerance:
        raise NotConfirmedError('the goal is off the plane of the arm')
    pieces: dict[tuple[str, ...], list[Mapping[str, Any]]] = {}
    for piece in goal['pieces']:
        pieces.setdefault(tuple(piece['joints']), []).append(piece)
    count = 0
    for combo in arm.combos(int(goal['order'])):
        names = tuple(arm.names[j] for j in combo)
        mine = pieces.get(names, [])
        q = np.array([piece['posture'] for piece in mine], float).reshape(-1, arm.n)
        half = np.array([piece['half'] for piece in mine], float).reshape(-1, len(combo))
        if not (np.isfinite(q).all() and np.isfinite(half).all() and (half >= 0.0).all()):
            raise ValueError('a piece has a number that is not finite, or a negative half-width')
        q = _first_turn(arm, q)
        lows, highs = _both_turns(arm, combo, *proved_boxes(arm, target, combo, q, half, radius))
        left = uncovered(arm.operating[0, combo], arm.operating[1, combo], lows, highs)
        if left is not None:
            where = ', '.join(names)
            raise NotConfirmedError(f'{where} at {left.round(6).tolist()} is covered by no proof')
        count += len(lows)
    # What a planar arm can do nothing about is no part of its ball.
    kind = 'ball' if arm.normal is None else 'disc'
    around = f', for the {kind} of {radius:g} m around it' if radius > 0.0 else ''
    return f'{count} proved boxes cover every combination{around}'


def _first_turn(arm: Arm, q: Array) -> Array:
    """Postures (N, n) with joints without limits in the turn about their operating range."""
    middle = 0.5 * (arm.operating[0] + arm.operating[1])
    turns = np.where(arm.wraps, np.round((q - middle) / (2.0 * np.pi)), 0.0)
    first: Array = q - 2.0 * np.pi * turns
    return first


def _both_turns(arm: Arm, combo: list[int], lows: Array, highs: Array) -> tuple[Array, Array]:
    """Boxes, and as they come round again at the other end of a full turn."""
    for column, joint in enumerate(combo):
        if not arm.wraps[joint]:
            continue
        move = np.zeros(len(combo))
        move[column] = 2.0 * np.pi
        before = lows[:, column] + move[column] <= arm.operating[1, joint]
        after = highs[:, column] - move[column] >= arm.operating[0, joint]
        lows, highs = (
            np.concatenate([ends, ends[before] + move, ends[after] - move])
            for ends in (lows, highs)
        )
    return lows, highs


def check_region(
    arm: Arm,
    region: Mapping[str, Any],
    goals: Sequence[Mapping[str, Any]],
    confirmed: Sequence[bool],
) -> str:
    """Check that confirmed balls of goals cover a volume: the boxes inside them do.

    Parameters
    ----------
    region
        Shape, centre, half edges or radius; the cells: boxes, each with the number of its goal.
    goals, confirmed
        The certificate's goals, and whether each is confirmed.

    Returns
    -------
    str
        What was confirmed.

    Raises
    ------
    NotConfirmedError
        If a part of the volume is in no cell, or a cell sticks out of its ball.
    """
    if arm.normal is not None:
        raise NotConfirmedError('an arm that moves in a plane reaches no volume whole')
    centre = np.array(region['center'], float).reshape(3)
    radius = np.inf
    if region['shape'] == 'sphere':
        radius = float(region['radius'])
        half = np.full(3, radius)
    elif region['shape'] == 'box':
        half = np.array(region['half'], float).reshape(3)
    else:
        raise NotConfirmedError(f'shape {region["shape"]!r} is not one of box, sphere')
    if not (half > 0.0).all():
        raise NotConfirmedError(f'{half.tolist()} are no half edges of a volume')
    lows, highs = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for cell in region['cells']:
        number = int(cell['goal'])
        goal = goals[number] if 0 <= number < len(goals) else {'verdict': 'missing'}
        place, size = np.array(cell['center'], float), np.array(cell['half'], float)
        if not (goal['verdict'] == 'member' and confirmed[number]):
            raise NotConfirmedError(f'goal {number} is no confirmed member')
        if any(goal.get(key) != region.get(key) for key in ('order', 'orientation')):
            raise NotConfirmedError(f'goal {number} is of another order or orientation')
        off = np.linalg.norm(np.abs(place - goal['point']) + size)
        if not off <= float(goal.get('radius', 0.0)):
            raise NotConfirmedError(f'the cell of goal {number} sticks out of its ball')
        lows.append((place - size - _TOUCHING)[None])
        highs.append((place + size + _TOUCHING)[None])

    def outside(low: Sequence[float], high: Sequence[float]) -> bool:
        nearest = np.clip(centre, low, high)
        return bool(np.linalg.norm(nearest - centre) > radius)

    left = uncovered(
        centre - half, centre + half, np.concatenate(lows), np.concatenate(highs), outside
    )
    if left is not None:
        raise NotConfirmedError(f'the point {left.round(6).tolist()} is in no confirmed ball')
    return f'covered by {len(lows) - 1} confirmed balls'


def _check_lost(
    arm: Arm, goal: Mapping[str, Any], target: Array, radius: float, budget: int
) -> str:
    at = {arm.index(name): a for name, a in zip(goal['joints'], goal['angles'], strict=True)}
    for joint, angle in at.items():
        if not arm.operating[0, joint] - 1e-9 <= angle <= arm.operating[1, joint] + 1e-9:
            raise NotConfirmedError(f'{arm.names[joint]} cannot freeze at {angle}')
    least = arm.tolerance + radius
    if arm.plane_distance(target) > least:
        return 'the goal is off the plane of the arm'
    try:
        spent = prove_lost(arm, target, at, float(goal['residual']), least, budget)
    except NotLostError as error:
        raise NotConfirmedError(str(error)) from None
    return f'refuted again with {spent} boxes'
