"""Reachability by brute force, sharing nothing with the package: plain numpy FK and scipy."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
from scipy.optimize import least_squares


def dh_frame(d, a, alpha, q):
    """Tool frame (4, 4) of T_i = Rz(q_i) Tz(d_i) Tx(a_i) Rx(alpha_i), by matrix products."""
    frame = np.eye(4)
    for di, ai, ti, qi in zip(d, a, alpha, q, strict=True):
        c, s, ca, sa = np.cos(qi), np.sin(qi), np.cos(ti), np.sin(ti)
        frame = frame @ np.array(
            [
                [c, -s * ca, s * sa, ai * c],
                [s, c * ca, -c * sa, ai * s],
                [0.0, sa, ca, di],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )
    return frame


def worst_miss(d, a, alpha, lower, upper, point, *, order=1, angles=9, starts=12, seed=0):
    """Largest distance (m) by which a ROD misses ``point``, over a grid of frozen angles."""
    n = len(d)
    rng = np.random.default_rng(seed)
    worst, where = 0.0, None
    for frozen in combinations(range(n), order):
        free = [j for j in range(n) if j not in frozen]
        near = None
        for values in product(*(np.linspace(lower[j], upper[j], angles) for j in frozen)):
            q = np.zeros(n)
            q[list(frozen)] = values

            def residual(x, q=q, free=free):
                posture = q.copy()
                posture[free] = x
                return dh_frame(d, a, alpha, posture)[:3, 3] - point

            best = np.inf
            for attempt in range(starts):
                # The posture at the last frozen angle is often close; the others are random.
                warm = attempt == 0 and near is not None
                start = near if warm else rng.uniform(lower[free], upper[free])
                found = least_squares(residual, start, bounds=(lower[free], upper[free]))
                best = min(best, float(np.linalg.norm(found.fun)))
                if best < 1e-6:
                    near = found.x
                    break
            if best > worst:
                worst, where = best, (frozen, values)
    return worst, where
