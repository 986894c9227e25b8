"""The verifier's own search for postures: right inverses, Newton's method, descent."""

from __future__ import annotations

import numpy as np

from ft_manip_ros.core.ftws.verifier_arm import Arm, Array

# Closer to a limit than this (rad or m), a joint is asked to contribute less.
_LIMIT_ZONE = 0.4
_LEAST_SHARE = 1e-2
# Residuals (m) below this are as good as none.
_EXACT = 1e-11
_LONGEST_STEP = 0.3


def right_inverse(arm: Arm, jacobian: Array, q: Array, free: list[int]) -> Array:
    """Right inverses (N, f, m) of Jacobians (N, m, f) that ask less of joints near limits."""
    lower, upper = arm.lower[free], arm.upper[free]
    zone = np.minimum(_LIMIT_ZONE, 0.5 * (upper - lower))
    gap = np.minimum(q[:, free] - lower, upper - q[:, free])
    share = np.clip(gap / np.maximum(zone, 1e-12), _LEAST_SHARE, 1.0)
    weights = np.where(arm.wraps[free], 1.0, share) ** 2
    weighted = jacobian * weights[:, None, :]
    gram = weighted @ jacobian.transpose(0, 2, 1)
    m = gram.shape[1]
    # Where the Jacobian is singular, the least bit of damping.
    damping = 1e-14 * np.trace(gram, axis1=1, axis2=2) + 1e-30
    gram = gram + damping[:, None, None] * np.eye(m)
    inverse: Array = weighted.transpose(0, 2, 1) @ np.linalg.inv(gram)
    return inverse


def correct(arm: Arm, q: Array, free: list[int], goal: Array, steps: int = 6) -> Array:
    """Newton's method on the free joints of postures (N, n)."""
    q = q.copy()
    rows = np.arange(len(q))
    for _ in range(steps):
        residual, jacobian = arm.jacobians(q[rows], goal)
        wrong = np.linalg.norm(residual, axis=1) > _EXACT
        rows = rows[wrong]
        if not len(rows):
            break
        inverse = right_inverse(arm, jacobian[wrong][:, :, free], q[rows], free)
        step = np.einsum('nir,nr->ni', inverse, residual[wrong])
        largest = np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-300)
        moved = q[rows]
        moved[:, free] -= step * np.minimum(1.0, _LONGEST_STEP / largest)
        q[rows] = moved
    return q


def descend(arm: Arm, q: Array, free: list[int], goal: Array) -> Array:
    """Damped Gauss-Newton within the limits, towards a local minimum of the residual; q (n,)."""
    q = q.copy()
    damping = 1e-2
    norm = float(np.linalg.norm(arm.residuals(q[None], goal)))
    for _ in range(60):
        residual, jacobian = arm.jacobians(q[None], goal)
        part = jacobian[0][:, free]
        normal = part.T @ part + damping * np.eye(len(free))
        trial = q.copy()
        trial[free] -= np.linalg.solve(normal, part.T @ residual[0])
        trial = np.where(arm.wraps, trial, np.clip(trial, arm.lower, arm.upper))
        after = float(np.linalg.norm(arm.residuals(trial[None], goal)))
        damping = max(damping * 0.3, 1e-9) if after < norm else damping * 4.0
        if after < norm:
            q, norm = trial, after
    return q
