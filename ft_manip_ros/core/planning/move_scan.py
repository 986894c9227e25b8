"""Whether a straight move of the healthy joints is free, for searches in compiled code."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.planning.bounding import BoundingBodies
from ft_manip_ros.core.planning.clearance import TOUCH, scan_move

# What a search knows about a move; `ASK` is no answer, bodies are too near for capsules to tell.
UNKNOWN, FREE, BLOCKED, ASK = range(4)


class MoveScan(NamedTuple):
    """What `judged` needs beside a move; made by `CollisionChecker.scan`."""

    compiled: bool  # whether anything is known here: else every answer is `ASK`
    bodies: BoundingBodies
    checked: NDArray[np.int64]  # (C,), pairs to look at
    approach: Array  # (P, n), how far each pair approaches per joint motion, m per rad or 1
    slides: Array  # (n,), how far prismatic axes slide per joint motion
    lower: Array  # (n,)
    upper: Array  # (n,)
    driver: NDArray[np.int64]  # (N,), of arms with mimic joints
    ratio: Array  # (N,)
    here: Array  # (n,), where the frozen joints stand
    healthy: NDArray[np.int64]  # (m,), places of the joints that move
    padding: float  # m
    halvings: int
    pieces: Array  # (R, 2), scratch
    pairs: NDArray[np.int64]  # (R,), scratch


def no_scan() -> MoveScan:
    """Return a scan that knows nothing, of the same type as one that does."""
    none, whole, flags = np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.bool_)
    plane, space = np.zeros((0, 3)), np.zeros((0, 3, 3))
    bodies = BoundingBodies(
        rotations=space,
        translations=plane,
        prismatic=flags,
        axis=whole,
        ends=np.zeros((0, 2, 3)),
        radius=none,
        exact=flags,
        points=plane,
        begin=whole,
        round=none,
        whole=flags,
        boxed=flags,
        box_rotation=space,
        box_centre=plane,
        box_half=plane,
        first=whole,
        second=whole,
    )
    return MoveScan(
        compiled=False,
        bodies=bodies,
        checked=whole,
        approach=np.zeros((0, 0)),
        slides=none,
        lower=none,
        upper=none,
        driver=whole,
        ratio=none,
        here=none,
        healthy=whole,
        padding=0.0,
        halvings=0,
        pieces=np.zeros((0, 2)),
        pairs=whole,
    )


@njit(cache=True, nogil=True)
def _axes(scan: MoveScan, q: Array) -> Array:
    """Axis positions at joint positions."""
    count = scan.driver.shape[0]
    if count == 0:
        return q.copy()
    s = np.empty(count)
    for k in range(count):
        s[k] = scan.ratio[k] * q[scan.driver[k]]
    return s


@njit(cache=True, nogil=True)
def _approaches(scan: MoveScan, a: Array, b: Array) -> Array:
    """How far (m) the bodies of each pair, (P,), approach on the way from a to b, (n,)."""
    approach, slides = scan.approach, scan.slides
    n = a.shape[0]
    # A frozen joint may have slid beyond its range, and swings what it carries wider.
    beyond = 0.0
    for i in range(n):
        if slides[i] > 0.0:
            low, high = min(a[i], b[i]), max(a[i], b[i])
            beyond += slides[i] * max(scan.lower[i] - low, high - scan.upper[i], 0.0)
    out = np.zeros(approach.shape[0])
    for k in range(approach.shape[0]):
        for i in range(n):
            if approach[k, i] > 0.0:
                out[k] += (approach[k, i] + beyond) * abs(b[i] - a[i])
    return out


@njit(cache=True, nogil=True)
def judged(scan: MoveScan, a: Array, b: Array) -> int:
    """Say whether the straight move between postures of the healthy joints, (m,), is free.

    Returns `FREE`, `BLOCKED`, or `ASK`.
    """
    if not scan.compiled:
        return ASK
    full_a, full_b = scan.here.copy(), scan.here.copy()
    for i in range(a.shape[0]):
        full_a[scan.healthy[i]], full_b[scan.healthy[i]] = a[i], b[i]
    count = scan_move(
        scan.bodies,
        _axes(scan, full_a),
        _axes(scan, full_b),
        scan.checked,
        _approaches(scan, full_a, full_b),
        scan.padding,
        scan.halvings,
        scan.pieces,
        scan.pairs,
    )
    if count == 0:
        return FREE
    return BLOCKED if count == TOUCH else ASK
