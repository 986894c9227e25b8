"""Reach table: where the tool can be at all with joints frozen, from lengths and twists alone.

Seen from a joint's axis, what the later joints can do is enclosed by an interval of heights
along the axis and one of radii about it. The intervals are carried from the tool to the first
free axis for a sample of frozen positions; a goal outside of one of them is refuted at once, by
a distance. The table is the arm's alone: it is made once and asked for every goal.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.kernels import frames

# Widening of every interval for rounding (m, relative to 1 m of arm).
_ROUNDING = 1e-9


@kernel
def _foot(z: Array, o: Array, other_z: Array, other_o: Array, out: Array) -> None:
    """Point of the axis (z, o) nearest to another axis; ``o`` where they are parallel."""
    along = z[0] * other_z[0] + z[1] * other_z[1] + z[2] * other_z[2]
    square = 1.0 - along * along
    t = 0.0
    if square > 1e-12:
        a = b = 0.0
        for c in range(3):
            a += (other_o[c] - o[c]) * z[c]
            b += (other_o[c] - o[c]) * other_z[c]
        t = (a - along * b) / square
    for c in range(3):
        out[c] = o[c] + t * z[c]


@njit(cache=True, nogil=True)
def reach_table(
    chain: ChainArrays,
    combos: NDArray[np.int64],
    ranges: Array,
    samples: int,
    length: float,
) -> Array:
    """Enclosures of the tool's place, one row per combination and sample of frozen positions.

    Parameters
    ----------
    combos : shape (C, k)
    ranges : shape (2, n)
        Where joints can freeze.
    samples : int
        Positions per frozen joint, ends included.
    length : float
        Scale of the arm, for rounding (m).

    Returns
    -------
    ndarray, shape (T, k + 11)
        Combination, frozen positions, a point and the direction of the first free axis,
        lowest and highest height, smallest and largest radius (m). No rows for arms with a
        free slide.
    """
    count, k = combos.shape
    n = ranges.shape[1]
    per = samples**k
    table = np.empty((count * per, k + 11))
    axes, origins = np.empty((n, 3)), np.empty((n, 3))
    tip_rotation, tip = np.empty((3, 3)), np.empty(3)
    points = np.empty((n, 3))
    free = np.empty(n, dtype=np.int64)
    q = np.zeros(n)
    rows = 0
    slack = _ROUNDING * (1.0 + length)
    for c in range(count):
        nf = 0
        usable = True
        for i in range(n):
            frozen = False
            for j in range(k):
                frozen = frozen or combos[c, j] == i
            if not frozen:
                free[nf] = i
                nf += 1
                usable = usable and not chain.prismatic[i]
        if not usable or nf == 0:
            continue
        for sample in range(per):
            rest = sample
            for j in range(k):
                joint = combos[c, j]
                share = (rest % samples) / max(samples - 1, 1)
                rest //= samples
                q[joint] = ranges[0, joint] + share * (ranges[1, joint] - ranges[0, joint])
                table[rows, 1 + j] = q[joint]
            frames(chain, q, axes, origins, tip_rotation, tip)
            for f in range(nf):
                i = free[f]
                other = free[f - 1] if f > 0 else (free[1] if nf > 1 else i)
                if other == i:
                    points[i] = origins[i]
                else:
                    _foot(axes[i], origins[i], axes[other], origins[other], points[i])
            i = free[nf - 1]
            low = 0.0
            square = 0.0
            for a in range(3):
                low += (tip[a] - points[i, a]) * axes[i, a]
                square += (tip[a] - points[i, a]) ** 2
            high = low
            inner = outer = math.sqrt(max(square - low * low, 0.0))
            for f in range(nf - 2, -1, -1):
                i, following = free[f], free[f + 1]
                low, high, inner, outer = _carry(
                    axes[i], axes[following], points[i], points[following], low, high, inner, outer
                )
            i = free[0]
            row = table[rows]
            row[0] = c
            for a in range(3):
                row[k + 1 + a] = points[i, a]
                row[k + 4 + a] = axes[i, a]
            row[k + 7], row[k + 8] = low - slack, high + slack
            row[k + 9], row[k + 10] = inner - slack, outer + slack
            rows += 1
    return table[:rows]


@kernel
def _carry(
    z: Array,
    next_z: Array,
    point: Array,
    next_point: Array,
    low: float,
    high: float,
    inner: float,
    outer: float,
) -> tuple[float, float, float, float]:
    """Heights and radii about one axis from those about the next; the joint between turns."""
    cosine = height = next_height = square = 0.0
    for a in range(3):
        e = next_point[a] - point[a]
        cosine += z[a] * next_z[a]
        height += e * z[a]
        next_height += e * next_z[a]
        square += e * e
    cosine = min(max(cosine, -1.0), 1.0)
    sine = math.sqrt(1.0 - cosine * cosine)
    aside = math.sqrt(max(square - height * height, 0.0))
    next_aside = math.sqrt(max(square - next_height * next_height, 0.0))
    # Squared distance from this point: the next height adds, the next radius turns freely.
    near = min(abs(next_height + low), abs(next_height + high))
    if next_height + low <= 0.0 <= next_height + high:
        near = 0.0
    far = max(abs(next_height + low), abs(next_height + high))
    gap = max(next_aside - outer, inner - next_aside, 0.0)
    nearest = near * near + gap * gap
    farthest = far * far + (next_aside + outer) ** 2
    new_low = height + min(cosine * low, cosine * high) - sine * outer
    new_high = height + max(cosine * low, cosine * high) + sine * outer
    reach = math.sqrt(farthest)
    new_low, new_high = max(new_low, -reach), min(new_high, reach)
    lowest = 0.0 if new_low <= 0.0 <= new_high else min(abs(new_low), abs(new_high))
    highest = max(abs(new_low), abs(new_high))
    new_outer = math.sqrt(max(farthest - lowest * lowest, 0.0))
    new_inner = math.sqrt(max(nearest - highest * highest, 0.0))
    # The part across the axis is the offset plus what is turned about the next axis.
    spread = outer + sine * max(abs(low), abs(high))
    new_outer = min(new_outer, aside + spread)
    if sine < 1e-12:
        new_inner = max(new_inner, aside - outer, inner - aside)
    return new_low, new_high, new_inner, new_outer


@kernel
def farthest_miss(table: Array, goal: Array, k: int) -> tuple[float, int]:
    """Largest distance (m) of a goal from an enclosure of the table, and its row (-1: none)."""
    best = 0.0
    at = -1
    for r in range(table.shape[0]):
        row = table[r]
        x, y, z = goal[0] - row[k + 1], goal[1] - row[k + 2], goal[2] - row[k + 3]
        height = x * row[k + 4] + y * row[k + 5] + z * row[k + 6]
        radius = math.sqrt(max(x * x + y * y + z * z - height * height, 0.0))
        up = max(row[k + 7] - height, height - row[k + 8], 0.0)
        out = max(row[k + 9] - radius, radius - row[k + 10], 0.0)
        miss = math.sqrt(up * up + out * out)
        if miss > best:
            best = miss
            at = r
    return best, at
