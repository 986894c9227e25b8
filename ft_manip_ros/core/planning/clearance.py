"""Compiled bounds on how near bodies are, at a posture and along a straight joint-space move."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.kernels import sin_cos
from ft_manip_ros.core.planning.bounding import BoundingBodies
from ft_manip_ros.core.planning.pair_distance import closer_look, segment_distance

# Instead of a number of open questions: bodies touch; there are more than there is room for.
TOUCH = -1
NO_ROOM = -2
# Where bodies approach each other by less than this (m) within half a piece, what capsules and
# hulls do not settle is left open: in smaller pieces they would say the same.
_NEAR = 0.01


@njit(cache=True, nogil=True)
def _place(bodies: BoundingBodies, s: Array, frames: Array, ends: Array) -> None:
    """Write where axes, (N+1, 12), and segments' ends, (B, 2, 3), are at axis positions s, (N,).

    A frame is its rotation, row by row, and its place; the first one is the base.
    """
    rotations, translations, prismatic = bodies.rotations, bodies.translations, bodies.prismatic
    axis, local = bodies.axis, bodies.ends
    frames[0] = 0.0
    frames[0, 0] = frames[0, 4] = frames[0, 8] = 1.0
    for i in range(s.shape[0]):
        before, after = frames[i], frames[i + 1]
        for a in range(3):
            x, y, z = before[3 * a], before[3 * a + 1], before[3 * a + 2]
            at = before[9 + a]
            at += x * translations[i, 0] + y * translations[i, 1] + z * translations[i, 2]
            for b in range(3):
                after[3 * a + b] = (
                    x * rotations[i, 0, b] + y * rotations[i, 1, b] + z * rotations[i, 2, b]
                )
            after[9 + a] = at
        if prismatic[i]:
            for a in range(3):
                after[9 + a] += after[3 * a + 2] * s[i]
        else:
            sine, cosine = sin_cos(s[i])
            for a in range(3):
                x, y = after[3 * a], after[3 * a + 1]
                after[3 * a], after[3 * a + 1] = x * cosine + y * sine, y * cosine - x * sine
    for k in range(axis.shape[0]):
        frame = frames[axis[k] + 1]
        for e in range(2):
            x, y, z = local[k, e, 0], local[k, e, 1], local[k, e, 2]
            for a in range(3):
                ends[k, e, a] = (
                    frame[3 * a] * x + frame[3 * a + 1] * y + frame[3 * a + 2] * z + frame[9 + a]
                )


@njit(cache=True, nogil=True)
def scan_posture(
    bodies: BoundingBodies,
    s: Array,
    checked: NDArray[np.int64],
    wanted: Array,
    pairs: NDArray[np.int64],
) -> int:
    """Judge a posture as far as capsules and hulls do.

    Parameters
    ----------
    s : shape (N,)
        Axis positions.
    checked : shape (C,)
        Pairs to look at.
    wanted : shape (P,)
        Distances (m) that the bodies of each pair are to keep.
    pairs : shape (P,), out
        Pairs that may be nearer.

    Returns
    -------
    How many may be, or `TOUCH` where some are.
    """
    frames, ends = np.empty((s.shape[0] + 1, 12)), np.empty((bodies.axis.shape[0], 2, 3))
    _place(bodies, s, frames, ends)
    # Every look-up of a tuple's field inside a loop costs two atomic reference counts.
    first, second, radius = bodies.first, bodies.second, bodies.radius
    count = 0
    for k in checked:
        i, j = first[k], second[k]
        lower = segment_distance(ends, i, j) - radius[i] - radius[j]
        if lower > wanted[k]:
            continue
        lower, upper = closer_look(bodies, frames, ends, k, lower, wanted[k])
        if lower > wanted[k]:
            continue
        if upper <= wanted[k]:
            return TOUCH
        pairs[count] = k
        count += 1
    return count


@njit(cache=True, nogil=True)
def scan_move(
    bodies: BoundingBodies,
    a: Array,
    b: Array,
    checked: NDArray[np.int64],
    approach: Array,
    padding: float,
    halvings: int,
    pieces: Array,
    pairs: NDArray[np.int64],
) -> int:
    """Judge a straight joint-space move as far as capsules do.

    Around the middle of a piece of the move, the bodies of a pair approach each other by no
    more than ``approach`` times half the piece. Pairs that are farther apart than that (and the
    padding) are settled for the piece; for the others it is halved.

    Parameters
    ----------
    a, b : shape (N,)
        Axis positions at both ends.
    checked : shape (C,)
        Pairs to look at.
    approach : shape (P,)
        How far the bodies of each pair can approach over the whole move (m).
    padding
        Distance (m) that bodies are to keep.
    halvings
        After so many, what is still too near to tell apart counts as touching.
    pieces : shape (R, 2), out
        First and last part, of the way from 0 to 1, of the pieces that are open.
    pairs : shape (R,), out
        The pair in question for each.

    Returns
    -------
    How many pieces are open; `TOUCH`; or `NO_ROOM`, for more of them.
    """
    frames, ends = np.empty((a.shape[0] + 1, 12)), np.empty((bodies.axis.shape[0], 2, 3))
    s = np.empty(a.shape[0])
    first, second, radius = bodies.first, bodies.second, bodies.radius
    order = checked.copy()
    begins, levels = np.empty(halvings + 2), np.empty(halvings + 2, dtype=np.int64)
    counts = np.empty(halvings + 2, dtype=np.int64)
    begins[0], levels[0], counts[0] = 0.0, 0, order.shape[0]
    top, found = 1, 0
    while top > 0:
        top -= 1
        begin, level, count = begins[top], levels[top], counts[top]
        half = 0.5 ** (level + 1)
        middle = begin + half
        for i in range(s.shape[0]):
            s[i] = a[i] + middle * (b[i] - a[i])
        _place(bodies, s, frames, ends)
        # Pairs to look at in the halves come first; swaps leave those of other pieces in place.
        kept = 0
        for place in range(count):
            k = order[place]
            wanted = padding + half * approach[k]
            i, j = first[k], second[k]
            lower = segment_distance(ends, i, j) - radius[i] - radius[j]
            if lower > wanted:
                continue
            lower, upper = closer_look(bodies, frames, ends, k, lower, wanted)
            if lower > wanted:
                continue
            if upper <= padding or (upper <= wanted and level == halvings):
                return TOUCH
            if level == halvings or (lower <= padding and wanted <= padding + _NEAR):
                if found == pairs.shape[0]:
                    return NO_ROOM
                pieces[found, 0], pieces[found, 1], pairs[found] = begin, begin + 2.0 * half, k
                found += 1
                continue
            order[place], order[kept] = order[kept], k
            kept += 1
        if kept:
            begins[top], levels[top], counts[top] = middle, level + 1, kept
            begins[top + 1], levels[top + 1], counts[top + 1] = begin, level + 1, kept
            top += 2
    return found
