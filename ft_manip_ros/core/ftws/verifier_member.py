"""Proof that a goal stays reachable over whole boxes of frozen positions.

At a posture x0 with k joints frozen at the centre of a box, take the family::

    x(delta, y) = x0 + T delta + 1/2 Q[delta, delta] + A y,    |y| <= rho

with A a right inverse of the free joints' Jacobian, T the tangent that holds the goal to first
order while the frozen joints move by delta, and Q what cancels the second. By Taylor's theorem
the residual there is ``y + E``, and E is bounded by the second derivative at x0 and a bound of
the third. Where ``|E| <= rho`` throughout, ``y -> y - F`` maps the ball into itself and has a
fixed point (Brouwer): an exact solution for each delta. A goal that is moved by s adds s to E.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.ftws.verifier_arm import Arm, Array
from ft_manip_ros.core.ftws.verifier_postures import correct, right_inverse

ABSOLUTE_ROUNDING = 1e-11
RELATIVE_ROUNDING = 1e-9
# Boxes reach this far into each other (rad or m), lest rounding part them.
_OVERLAP = 1e-12
# How often a box is halved, and balls tried on each.
_DEPTH = 16
_BALLS = 10
# How far (rad or m) postures of halved boxes start from the limits.
_INSET = 5e-3
# Boxes taken at once, and how many may come of them before the rest counts as not proved.
_CHUNK = 2048
_MOST_BOXES = 20_000
# Halvings without a single proof after which no more are tried.
_PATIENCE = 8


def proved_boxes(
    arm: Arm, target: Array, combo: list[int], q: Array, half: Array, radius: float
) -> tuple[Array, Array]:
    """Return the boxes, or halves of them, over which every goal of a ball is reachable.

    Parameters
    ----------
    combo
        The k frozen joints.
    q : shape (N, n)
        Postures at the centres of the boxes: hints, that are corrected here.
    half : shape (N, k)
        Half-widths of the boxes (rad or m).
    radius
        Of the ball of goals around the target (m).

    Returns
    -------
    low, high : shape (M, k)
        Ends of the proved boxes. What could not be proved is left out.
    """
    lows, highs = [np.zeros((0, len(combo)))], [np.zeros((0, len(combo)))]
    for first in range(0, len(q), _CHUNK):
        boxes = q[first : first + _CHUNK], half[first : first + _CHUNK] + _OVERLAP
        vain = 0
        for _ in range(_DEPTH + 1):
            if not 0 < len(boxes[0]) <= _MOST_BOXES or vain > _PATIENCE:
                break
            centre, width, proved, tangent = _try(arm, target, combo, *boxes, radius)
            vain = 0 if proved.any() else vain + 1
            lows.append(centre[proved][:, combo] - width[proved])
            highs.append(centre[proved][:, combo] + width[proved])
            boxes = _halved(arm, combo, centre[~proved], width[~proved], tangent[~proved])
    return np.concatenate(lows), np.concatenate(highs)


def _try(
    arm: Arm, target: Array, combo: list[int], q: Array, half: Array, radius: float
) -> tuple[Array, Array, NDArray[np.bool_], Array]:
    """Correct postures and try the proof on each: postures, half-widths, which hold, tangents."""
    free = [i for i in range(arm.n) if i not in combo]
    q = correct(arm, q, free, target)
    at = arm.derivatives(q, target)
    m = at.residual.shape[1]
    inverse = np.zeros((len(q), arm.n, m))
    inverse[:, free] = right_inverse(arm, at.jacobian[:, :, free], q, free)
    tangent = -inverse @ at.jacobian[:, :, combo]
    tangent[:, combo, range(len(combo))] = 1.0

    # The family's directions: T, then Q by pairs of frozen joints; sizes over the box.
    i, j = np.triu_indices(len(combo))
    bent = at.hessian @ tangent[:, None]
    curve = (tangent.transpose(0, 2, 1)[:, None] @ bent)[:, :, i, j]
    directions = np.concatenate([tangent, -inverse @ curve], axis=2)
    size = np.concatenate([half, np.where(i == j, 0.5, 1.0) * half[:, i] * half[:, j]], axis=1)

    # What E has to first order: the start, and what rounding leaves of the directions.
    first = at.jacobian @ directions
    first[:, :, len(combo) :] += curve
    start = np.linalg.norm(at.residual, axis=1) + radius + ABSOLUTE_ROUNDING
    start += (np.linalg.norm(first, axis=1) * size).sum(axis=1)
    defect = np.linalg.norm(at.jacobian @ inverse - np.eye(m), axis=(1, 2))

    # And to second order, by powers of rho; T with T is cancelled.
    bent = at.hessian @ directions[:, None]
    pairs = np.linalg.norm(directions.transpose(0, 2, 1)[:, None] @ bent, axis=1)
    pairs[:, : len(combo), : len(combo)] = 0.0
    start += 0.5 * np.einsum('nab,na,nb->n', pairs, size, size)
    crossed = inverse.transpose(0, 2, 1)[:, None]
    mixed = (np.linalg.norm(crossed @ bent, axis=(1, 2)) * size).sum(axis=1)
    square = np.sqrt(((crossed @ at.hessian @ inverse[:, None]) ** 2).sum(axis=(1, 2, 3)))

    # How far joints move, and may.
    along = np.einsum('nia,na->ni', np.abs(directions), size)
    gain = np.linalg.norm(inverse, axis=2)
    slack = np.where(arm.wraps, np.inf, np.minimum(q - arm.lower, arm.upper - q))
    slack[:, combo] = np.inf

    proved = np.zeros(len(q), dtype=bool)
    rho = np.zeros(len(q))
    for ball in range(_BALLS):
        v = along + gain * rho[:, None]
        error = start + rho * (defect + mixed + 0.5 * rho * square)
        error = (error + arm.third_bound(at.distance, v) / 6.0) * (1.0 + RELATIVE_ROUNDING)
        # Without a ball nothing is corrected, but the posture may be near enough as it is.
        allowed = arm.tolerance if ball == 0 else rho
        proved |= (error <= allowed) & (v <= slack).all(axis=1)
        rho = np.where(proved, rho, np.minimum(1.3 * error, 1e3))
    return q, half, proved, tangent


def _halved(
    arm: Arm, combo: list[int], q: Array, half: Array, tangent: Array
) -> tuple[Array, Array]:
    """Cut boxes across, where the posture moves most; each half gets a posture along T."""
    free = [i for i in range(arm.n) if i not in combo]
    rows = np.arange(len(q))
    side = np.argmax(half * np.linalg.norm(tangent, axis=1), axis=1)
    smaller = half.copy()
    smaller[rows, side] *= 0.5
    step = smaller[rows, side][:, None] * tangent[rows, :, side]
    smaller[rows, side] += _OVERLAP
    q, half = np.concatenate([q - step, q + step]), np.concatenate([smaller, smaller])
    # Off the limits, where the self-motion allows it: at one, no box is admissible.
    inset = np.where(arm.wraps, -np.inf, np.minimum(_INSET, 0.25 * (arm.upper - arm.lower)))
    q[:, free] = np.clip(q[:, free], (arm.lower + inset)[free], (arm.upper - inset)[free])
    return q, half
