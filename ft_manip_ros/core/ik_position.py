"""Levenberg-Marquardt descent on the tool's position, inside the joint limits."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ik_types import CONVERGED, ITERATION_LIMIT, STALLED, IkControl, IkWork
from ft_manip_ros.core.kernels import sweep

# Damping per squared error: it fades as the error does, which keeps convergence quadratic.
DAMPING = 0.2
# Added so that the normal matrix stays regular at a singular posture (m^2).
FLOOR = 1e-14
# A descent that has not brought the squared error below RATIO of what it was WINDOW steps ago
# is given up: starting elsewhere is cheaper than crawling.
WINDOW = 4
RATIO = 0.25


@njit(cache=True, nogil=True, inline='always')
def solve3(
    a: tuple[float, float, float, float, float, float], b0: float, b1: float, b2: float
) -> tuple[float, float, float]:
    """Solve a symmetric positive definite 3 x 3 system; ``a`` = (00, 10, 20, 11, 21, 22)."""
    a00, a10, a20, a11, a21, a22 = a
    i0 = 1.0 / a00
    l10, l20 = a10 * i0, a20 * i0
    e21 = a21 - l20 * a10
    i1 = 1.0 / max(a11 - l10 * a10, 1e-300)
    l21 = e21 * i1
    y1 = b1 - l10 * b0
    y2 = (b2 - l20 * b0 - l21 * y1) / max(a22 - l20 * a20 - l21 * e21, 1e-300)
    y1 = y1 * i1 - l21 * y2
    return b0 * i0 - l10 * y1 - l20 * y2, y1, y2


@kernel
def descend_position(
    chain: ChainArrays,
    frozen: NDArray[np.bool_],
    target: Array,
    control: IkControl,
    q: Array,
    work: IkWork,
) -> tuple[int, int, float]:
    """Move ``q`` (n,) towards the target (3,); returns status, steps taken and error (m).

    Each step is the damped least-norm one that stays inside the limits: joints at a limit that
    the gradient pushes outwards do not take part; a joint whose step crosses its limit is put on
    it, and the others are solved again for what is left to do.

    ``q`` must begin inside the limits; frozen joints stay where they are. Joints that wrap may
    end some turns away.
    """
    rotations, translations, screws = chain.rotations, chain.translations, chain.screws
    prismatic, wraps, lower, upper = chain.prismatic, chain.wraps, chain.lower, chain.upper
    axes, origins, columns = work.axes, work.origins, work.columns
    step, free = work.step, work.free
    n = q.shape[0]
    enough = control.tolerance * control.tolerance
    mark = np.inf
    steps, judged = 0, 0
    while True:
        place, _ = sweep(rotations, translations, screws, prismatic, q, axes, origins)
        x, y, z = place
        e0, e1, e2 = target[0] - x, target[1] - y, target[2] - z
        cost = e0 * e0 + e1 * e1 + e2 * e2
        if cost <= enough:
            return CONVERGED, steps, math.sqrt(cost)
        if steps == judged:
            # Written so that overflow and NaN also end the descent.
            if not (cost <= RATIO * mark and cost < np.inf):
                return STALLED, steps, math.sqrt(cost)
            mark = cost
            judged += WINDOW
        if steps >= control.max_iterations:
            return ITERATION_LIMIT, steps, math.sqrt(cost)
        steps += 1
        a00 = a11 = a22 = DAMPING * cost + FLOOR
        a10 = a20 = a21 = 0.0
        for i in range(n):
            step[i] = 0.0
            free[i] = False
            if frozen[i]:
                continue
            u, v, w = axes[i, 0], axes[i, 1], axes[i, 2]
            if not prismatic[i]:
                dx, dy, dz = x - origins[i, 0], y - origins[i, 1], z - origins[i, 2]
                u, v, w = v * dz - w * dy, w * dx - u * dz, u * dy - v * dx
            if not wraps[i]:
                gradient = u * e0 + v * e1 + w * e2
                if (q[i] <= lower[i] and gradient < 0.0) or (q[i] >= upper[i] and gradient > 0.0):
                    continue
            free[i] = True
            columns[i, 0], columns[i, 1], columns[i, 2] = u, v, w
            a00 += u * u
            a10 += u * v
            a20 += u * w
            a11 += v * v
            a21 += v * w
            a22 += w * w
        for _ in range(n):
            y0, y1, y2 = solve3((a00, a10, a20, a11, a21, a22), e0, e1, e2)
            inside = True
            for i in range(n):
                if not free[i]:
                    continue
                u, v, w = columns[i, 0], columns[i, 1], columns[i, 2]
                s = u * y0 + v * y1 + w * y2
                if not wraps[i]:
                    low, high = lower[i] - q[i], upper[i] - q[i]
                    if s < low or s > high:
                        s = low if s < low else high
                        inside = False
                        free[i] = False
                        a00 -= u * u
                        a10 -= u * v
                        a20 -= u * w
                        a11 -= v * v
                        a21 -= v * w
                        a22 -= w * w
                        e0 -= u * s
                        e1 -= v * s
                        e2 -= w * s
                step[i] = s
            if inside:
                break
        for i in range(n):
            if not frozen[i]:
                q[i] += step[i]
                if not wraps[i]:
                    # Rounding must not leave the limit by a last digit.
                    q[i] = min(max(q[i], lower[i]), upper[i])
