"""Whether boxes cover a box: of frozen positions (k dimensions) or of points (3)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ft_manip_ros.core.ftws.verifier_arm import Array

# Cells that no more boxes than this touch are settled by cutting the boxes off one by one.
_FEW = 12
# Cells are not halved below this (rad or m): there edges of many boxes meet.
_SMALLEST = 1e-9

Edge = tuple[float, ...]


def nowhere(_low: Edge, _high: Edge) -> bool:
    """Return False: all of the box has to be covered."""
    return False


def uncovered(
    low: Array,
    high: Array,
    lows: Array,
    highs: Array,
    needless: Callable[[Edge, Edge], bool] = nowhere,
) -> Array | None:
    """Return a point of the box [low, high] that no box contains, or None.

    Parameters
    ----------
    low, high : shape (k,)
    lows, highs : shape (N, k)
        The boxes that should cover it. They are closed: boxes that touch leave no gap.
    needless
        Says of the ends of a box that nothing in it has to be covered.

    Returns
    -------
    ndarray, shape (k,), or None
    """
    stack = [(low, high, np.arange(len(lows)))]
    while stack:
        a, b, near = stack.pop()
        near = near[((lows[near] <= b) & (highs[near] >= a)).all(axis=1)]
        if ((lows[near] <= a) & (highs[near] >= b)).all(axis=1).any():
            continue
        if needless(tuple(a), tuple(b)):
            continue
        if len(near) <= _FEW or (b - a).max() <= _SMALLEST:
            boxes = list(zip(lows[near].tolist(), highs[near].tolist(), strict=True))
            left = _left_over(tuple(a.tolist()), tuple(b.tolist()), boxes, needless)
            if left is not None:
                return np.array(left)
            continue
        # Across the side that the boxes are smallest on, as the cell sees them.
        seen = np.minimum(highs[near], b) - np.maximum(lows[near], a)
        side = int(np.argmax((b - a) / (seen.mean(axis=0) + _SMALLEST)))
        middle = 0.5 * (a[side] + b[side])
        for part in (0, 1):
            lower, upper = a.copy(), b.copy()
            (upper if part == 0 else lower)[side] = middle
            stack.append((lower, upper, near))
    return None


def _left_over(
    low: Edge,
    high: Edge,
    boxes: list[tuple[list[float], list[float]]],
    needless: Callable[[Edge, Edge], bool],
) -> Edge | None:
    """Cut every box off what is left in turn; return a point of what then remains, or None."""
    stack = [(low, high, 0)]
    while stack:
        a, b, first = stack.pop()
        for i in range(first, len(boxes)):
            c, d = boxes[i]
            if any(
                cj > bj or dj < aj or (aj < bj and (cj >= bj or dj <= aj))
                for aj, bj, cj, dj in zip(a, b, c, d, strict=True)
            ):
                continue
            # What sticks out of box i on each side is left; the rest lies in it.
            for j in range(len(a)):
                if a[j] < c[j]:
                    stack.append((a, (*b[:j], c[j], *b[j + 1 :]), i + 1))
                    a = (*a[:j], c[j], *a[j + 1 :])
                if b[j] > d[j]:
                    stack.append(((*a[:j], d[j], *a[j + 1 :]), b, i + 1))
                    b = (*b[:j], d[j], *b[j + 1 :])
            break
        else:
            if not needless(a, b):
                return tuple(0.5 * (aj + bj) for aj, bj in zip(a, b, strict=True))
    return None
