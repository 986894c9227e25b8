"""Compiled bounds of all orders of the task map that a certificate does not know exactly.

A derivative of the tool's place is a nest of cross products, so its norm is at most the tool's
distance r_k to the axis of the last joint k that takes part. The task map's Taylor series at a
posture is therefore bounded, coefficient by coefficient, by that of ::

    G = sum_k r_k (exp S_k - exp S_(k-1))     with S_k = |a_1| + ... + |a_k|

over the hinges, each with the change ``|a_i|`` (a slide takes part once: ``|a_k| exp S_(k-1)``).
A derivative of order m of the error quaternion has norm ``2^-m``: that is ``exp(S / 2)``. Where
coefficients are known exactly their share of G is subtracted, and the norms take its place.

The changes are ``a(h) + e``: a polynomial of the frozen position's change h, and the rest e (the
correction y and the other frozen joints), whose powers from the third on are bounded by a
geometric series.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ftws.turn_series import CURVE

# Changes that sum up to more than this (rad) are not bounded at all.
_LARGEST = 3.0


class Majorant(NamedTuple):
    """Scratch of one posture's bounds: n joints."""

    sums: Array  # (n+1, CURVE+1), coefficients of S_k - those of e, by power of h; [k+1] of k
    known: Array  # (2, CURVE+1), G's coefficients in h alone: of the position, of the turn
    grown: Array  # (n+1,), exp S_k at the width in hand
    slid: Array  # (n,), change of a slide at that width
    rest: Array  # (2,), orders of h alone above CURVE at that width: position, turn


@njit(cache=True, nogil=True)
def make_majorant(n: int) -> Majorant:
    """Allocate the scratch of n joints."""
    return Majorant(
        np.zeros((n + 1, CURVE + 1)),
        np.zeros((2, CURVE + 1)),
        np.zeros(n + 1),
        np.zeros(n),
        np.zeros(2),
    )


@njit(cache=True, nogil=True, inline='always')
def _exponential(s1: float, s2: float, s3: float, s4: float) -> tuple[float, float, float, float]:
    """Coefficients 1 to 4 of the exponential of a series without constant term."""
    square = s1 * s1
    return (
        s1,
        s2 + 0.5 * square,
        s3 + s1 * s2 + square * s1 / 6.0,
        s4 + s1 * s3 + 0.5 * s2 * s2 + 0.5 * square * s2 + square * square / 24.0,
    )


@kernel
def begin(chain: ChainArrays, distance: Array, directions: Array, g: Majorant) -> None:
    """Prepare the bounds for a curve whose directions are the first CURVE rows."""
    prismatic, sums, known = chain.prismatic, g.sums, g.known
    for m in range(CURVE + 1):
        known[0, m] = known[1, m] = 0.0
    b1 = b2 = b3 = b4 = 0.0
    for k in range(distance.shape[0]):
        l1, l2 = abs(directions[0, k]), abs(directions[1, k])
        l3, l4 = abs(directions[2, k]), abs(directions[3, k])
        share = 0.0 if prismatic[k] else 1.0
        sums[k + 1, 1] = sums[k, 1] + share * l1
        sums[k + 1, 2] = sums[k, 2] + share * l2
        sums[k + 1, 3] = sums[k, 3] + share * l3
        sums[k + 1, 4] = sums[k, 4] + share * l4
        if prismatic[k]:
            known[0, 1] += l1
            known[0, 2] += l2 + l1 * b1
            known[0, 3] += l3 + l2 * b1 + l1 * b2
            known[0, 4] += l4 + l3 * b1 + l2 * b2 + l1 * b3
        else:
            e1, e2, e3, e4 = _exponential(
                sums[k + 1, 1], sums[k + 1, 2], sums[k + 1, 3], sums[k + 1, 4]
            )
            known[0, 1] += distance[k] * (e1 - b1)
            known[0, 2] += distance[k] * (e2 - b2)
            known[0, 3] += distance[k] * (e3 - b3)
            known[0, 4] += distance[k] * (e4 - b4)
            b1, b2, b3, b4 = e1, e2, e3, e4
    n = distance.shape[0]
    known[1, 1], known[1, 2], known[1, 3], known[1, 4] = _exponential(
        0.5 * sums[n, 1], 0.5 * sums[n, 2], 0.5 * sums[n, 3], 0.5 * sums[n, 4]
    )


@kernel
def widen(chain: ChainArrays, distance: Array, directions: Array, h: float, g: Majorant) -> None:
    """Go to one half-width h of the frozen joint: what depends on it alone."""
    prismatic, sums, known, grown, slid = chain.prismatic, g.sums, g.known, g.grown, g.slid
    n = distance.shape[0]
    total = 0.0
    grown[0] = 1.0
    s1, s2, s3, s4 = sums[n, 1], sums[n, 2], sums[n, 3], sums[n, 4]
    if h * (s1 + h * (s2 + h * (s3 + h * s4))) > _LARGEST:
        g.rest[0] = g.rest[1] = math.inf
        return
    for k in range(n):
        if prismatic[k]:
            slid[k] = h * (
                abs(directions[0, k])
                + h
                * (abs(directions[1, k]) + h * (abs(directions[2, k]) + h * abs(directions[3, k])))
            )
            grown[k + 1] = grown[k]
            total += slid[k] * grown[k]
        else:
            s1, s2, s3, s4 = sums[k + 1, 1], sums[k + 1, 2], sums[k + 1, 3], sums[k + 1, 4]
            grown[k + 1] = math.exp(h * (s1 + h * (s2 + h * (s3 + h * s4))))
            total += distance[k] * (grown[k + 1] - grown[k])
    lower = h * (known[0, 1] + h * (known[0, 2] + h * (known[0, 3] + h * known[0, 4])))
    g.rest[0] = max(total - lower, 0.0)
    lower = h * (known[1, 1] + h * (known[1, 2] + h * (known[1, 3] + h * known[1, 4])))
    g.rest[1] = max(math.sqrt(grown[n]) - 1.0 - lower, 0.0)


@kernel
def unknown(
    chain: ChainArrays,
    distance: Array,
    directions: Array,
    length: float,
    h: float,
    other: Array,
    corrected: Array,
    squared: bool,
    g: Majorant,
) -> float:
    """Bound of all that is not known exactly over the box.

    That is the orders above CURVE of h; and of what contains the rest e, all but the terms e, h e
    and, of the position, h^2 y; of two other frozen joints, or one and y, the products are known,
    and that of y with itself where it is said to be.

    Parameters
    ----------
    length : float
        Metres per radian of the orientation rows, 0 without them.
    h : float
        The half-width given to `widen`.
    other, corrected : shape (n,)
        Largest changes by the other frozen joints, and by y.
    squared : bool
        Whether the terms y^2 are known.
    """
    prismatic, sums, grown, slid = chain.prismatic, g.sums, g.grown, g.slid
    left = 0.0 if squared else 1.0
    if g.rest[0] == math.inf:
        return math.inf
    total = 0.0
    o = y = 0.0  # sums of e over the hinges so far, by source
    before = 0.0  # the last hinge's term
    for k in range(distance.shape[0]):
        oe, ye = other[k], corrected[k]
        s1 = sums[k + 1, 1]
        s2 = sums[k + 1, 2] + 0.5 * s1 * s1
        if prismatic[k]:
            e = o + y
            l1, l2 = abs(directions[0, k]), abs(directions[1, k])
            more = _powers(e)
            # (l + e_k) exp(S + E) - l exp(S), less what is known
            term = (slid[k] + oe + ye) * grown[k] * (1.0 + more) - slid[k] * grown[k]
            term -= (oe + ye) * (1.0 + h * s1) + h * l1 * e
            term -= h * h * (ye * s2 + y * (l2 + l1 * s1))
            term -= (oe + ye) * e - left * ye * y
            total += max(term, 0.0)
            continue
        o += oe
        y += ye
        e = o + y
        if e >= _LARGEST:
            return math.inf
        after = grown[k + 1] * _powers(e) - e * (1.0 + h * s1) - h * h * s2 * y
        after -= 0.5 * (e * e - left * y * y)
        total += distance[k] * (after - before)
        before = after
    total = max(total, 0.0) + g.rest[0]
    if length > 0.0:
        s1 = sums[distance.shape[0], 1]
        o, y = 0.5 * o, 0.5 * y
        e = o + y
        turn = math.sqrt(grown[distance.shape[0]]) * _powers(e) - e * (1.0 + 0.5 * h * s1)
        turn -= 0.5 * (e * e - left * y * y)
        turn = 2.0 * length * (max(turn, 0.0) + g.rest[1])
        total = math.sqrt(total * total + turn * turn)
    return total


@njit(cache=True, nogil=True, inline='always')
def _powers(e: float) -> float:
    """Bound of ``exp(e) - 1`` for e < 4, also coefficient by coefficient."""
    return e + 0.5 * e * e + e * e * e / (6.0 - 1.5 * e)
