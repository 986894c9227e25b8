"""Compiled distances of bodies: of segments and boxes exactly, of hulls between bounds."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.planning.bounding import BoundingBodies

# Halvings in the search for the point of a segment that is nearest to a box.
_NARROWINGS = 40
# Steps towards the distance of two hulls.
_GILBERT_STEPS = 16
# Squared sine of the angle below which segments count as parallel.
_PARALLEL = 1e-14


@njit(cache=True, nogil=True, inline='always')
def segment_distance(ends: Array, i: int, j: int) -> float:
    """Distance (m) between two of some segments, (B, 2, 3).

    As in Ericson, Real-Time Collision Detection (2005), section 5.1.9.
    """
    a = e = f = b = c = 0.0
    for x in range(3):
        u, v = ends[i, 1, x] - ends[i, 0, x], ends[j, 1, x] - ends[j, 0, x]
        w = ends[i, 0, x] - ends[j, 0, x]
        a += u * u
        e += v * v
        f += v * w
        b += u * v
        c += u * w
    s = t = 0.0
    if a > 0.0 and e > 0.0:
        across = a * e - b * b
        if across > _PARALLEL * a * e:
            s = min(1.0, max(0.0, (b * f - c * e) / across))
        t = (b * s + f) / e
        if t < 0.0:
            t, s = 0.0, min(1.0, max(0.0, -c / a))
        elif t > 1.0:
            t, s = 1.0, min(1.0, max(0.0, (b - c) / a))
    elif a > 0.0:
        s = min(1.0, max(0.0, -c / a))
    elif e > 0.0:
        t = min(1.0, max(0.0, f / e))
    total = 0.0
    for x in range(3):
        d = ends[i, 0, x] + s * (ends[i, 1, x] - ends[i, 0, x])
        d -= ends[j, 0, x] + t * (ends[j, 1, x] - ends[j, 0, x])
        total += d * d
    return math.sqrt(total)


@njit(cache=True, nogil=True)
def _box_slope(start: Array, way: Array, half: Array, t: float) -> float:
    """Half the derivative by t of the squared distance of ``start + t way`` to a box."""
    slope = 0.0
    for i in range(3):
        x = start[i] + t * way[i]
        if x > half[i]:
            slope += (x - half[i]) * way[i]
        elif x < -half[i]:
            slope += (x + half[i]) * way[i]
    return slope


@njit(cache=True, nogil=True)
def box_distance(p: Array, rotation: Array, centre: Array, half: Array) -> float:
    """Distance (m) between a segment (2, 3) and a solid box; it is convex along the segment."""
    start, way = np.empty(3), np.empty(3)
    for i in range(3):
        start[i] = way[i] = 0.0
        for a in range(3):
            start[i] += rotation[a, i] * (p[0, a] - centre[a])
            way[i] += rotation[a, i] * (p[1, a] - p[0, a])
    low, high = 0.0, 1.0
    if _box_slope(start, way, half, 0.0) >= 0.0:
        high = 0.0
    elif _box_slope(start, way, half, 1.0) <= 0.0:
        low = 1.0
    else:
        for _ in range(_NARROWINGS):
            t = 0.5 * (low + high)
            if _box_slope(start, way, half, t) > 0.0:
                high = t
            else:
                low = t
    t = 0.5 * (low + high)
    total = 0.0
    for i in range(3):
        d = max(0.0, abs(start[i] + t * way[i]) - half[i])
        total += d * d
    return math.sqrt(total)


@njit(cache=True, nogil=True, inline='always')
def _support(points: Array, begin: int, end: int, frame: Array, way: Array, sign: float) -> int:
    """Point, of some in a frame, that is farthest in a direction times a sign."""
    x = sign * (frame[0] * way[0] + frame[3] * way[1] + frame[6] * way[2])
    y = sign * (frame[1] * way[0] + frame[4] * way[1] + frame[7] * way[2])
    z = sign * (frame[2] * way[0] + frame[5] * way[1] + frame[8] * way[2])
    best, most = begin, -math.inf
    for i in range(begin, end):
        value = points[i, 0] * x + points[i, 1] * y + points[i, 2] * z
        if value > most:
            best, most = i, value
    return best


@njit(cache=True, nogil=True)
def _hull_gap(
    bodies: BoundingBodies, frames: Array, ends: Array, i: int, j: int, wanted: float
) -> tuple[float, float]:
    """Bounds (m) of the distance of two hulls: looked for until it is clear which is wanted.

    Gilbert's algorithm (SIAM J. Control 4, 1966): any direction gives a lower bound, that of
    the gap between two planes across it; any two points an upper one.
    """
    radii = bodies.round[i] + bodies.round[j]
    v, w = np.empty(3), np.empty(3)
    for a in range(3):
        v[a] = 0.5 * (ends[i, 0, a] + ends[i, 1, a] - ends[j, 0, a] - ends[j, 1, a])
    lower = -math.inf
    upper = math.inf
    points, begin = bodies.points, bodies.begin
    f, g = frames[bodies.axis[i] + 1], frames[bodies.axis[j] + 1]
    for step in range(_GILBERT_STEPS):
        length = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        if step > 0:
            upper = length - radii
        if upper <= wanted or length == 0.0:
            break
        p = points[_support(points, begin[i], begin[i + 1], f, v, -1.0)]
        q = points[_support(points, begin[j], begin[j + 1], g, v, 1.0)]
        along = down = over = 0.0
        for a in range(3):
            w[a] = f[3 * a] * p[0] + f[3 * a + 1] * p[1] + f[3 * a + 2] * p[2] + f[9 + a]
            w[a] -= g[3 * a] * q[0] + g[3 * a + 1] * q[1] + g[3 * a + 2] * q[2] + g[9 + a]
            along += v[a] * w[a]
            d = w[a] - v[a]
            down -= v[a] * d
            over += d * d
        lower = max(lower, along / length - radii)
        if lower > wanted or over == 0.0:
            break
        part = min(1.0, max(0.0, down / over)) if step > 0 else 1.0
        for a in range(3):
            v[a] += part * (w[a] - v[a])
    return lower, upper


@njit(cache=True, nogil=True)
def closer_look(
    bodies: BoundingBodies, frames: Array, ends: Array, k: int, lower: float, wanted: float
) -> tuple[float, float]:
    """Bounds (m) of the distance of a pair whose capsules are nearer than is ``wanted``."""
    i, j = bodies.first[k], bodies.second[k]
    if bodies.exact[i] and bodies.exact[j]:
        return lower, lower
    if bodies.boxed[i]:
        i, j = j, i
    if bodies.boxed[j]:
        to_box = box_distance(
            ends[i], bodies.box_rotation[j], bodies.box_centre[j], bodies.box_half[j]
        )
        to_box -= bodies.radius[i]
        if bodies.exact[i]:
            return to_box, to_box
        lower = max(lower, to_box)
        if lower > wanted:
            return lower, math.inf
    planes, upper = _hull_gap(bodies, frames, ends, i, j, wanted)
    if not (bodies.whole[i] and bodies.whole[j]):
        upper = math.inf
    return max(lower, planes), upper
