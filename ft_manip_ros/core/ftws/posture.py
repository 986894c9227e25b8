"""Compiled posture finding for the proofs: a Newton corrector and a seeded, bounded LM search.

Nothing here proves anything: postures are only where the covering and the refutation start.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ftws.local_model import LocalModel, evaluate
from ft_manip_ros.core.ftws.task_map import TaskArrays
from ft_manip_ros.core.ftws.weighting import (
    cholesky,
    cholesky_solve,
    factor_weighted,
    limit_weights,
    weighted_inverse,
)

_LARGEST_STEP = 0.6
_SEARCH_ITERATIONS = 60


@kernel
def uniform(state: NDArray[np.uint64]) -> float:
    """Next number of a splitmix64 stream in [0, 1); ``state`` (1,) is advanced."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    x = state[0]
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    x = x ^ (x >> np.uint64(31))
    return float(x >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@kernel
def randomise(
    chain: ChainArrays, q: Array, is_free: NDArray[np.bool_], state: NDArray[np.uint64]
) -> None:
    """Put the free joints anywhere within their limits."""
    lower, upper = chain.lower, chain.upper
    for i in range(q.shape[0]):
        if is_free[i]:
            q[i] = lower[i] + uniform(state) * (upper[i] - lower[i])


@kernel
def clamp(chain: ChainArrays, q: Array, is_free: NDArray[np.bool_]) -> None:
    """Put the free joints within their limits; joints that wrap into [-pi, pi)."""
    wraps, lower, upper = chain.wraps, chain.lower, chain.upper
    for i in range(q.shape[0]):
        if not is_free[i]:
            continue
        if wraps[i]:
            if not -math.pi <= q[i] < math.pi:
                q[i] -= 2.0 * math.pi * math.floor((q[i] + math.pi) / (2.0 * math.pi))
        else:
            q[i] = min(max(q[i], lower[i]), upper[i])


@kernel
def correct(
    chain: ChainArrays,
    task: TaskArrays,
    goal: Array,
    q: Array,
    is_free: NDArray[np.bool_],
    model: LocalModel,
    weights: Array,
    gram: Array,
    inverse: Array,
    tolerance: float,
    iterations: int,
) -> float:
    """Newton on the free joints from ``q`` (changed); returns the residual's norm (m).

    On return ``model``, ``weights``, ``gram`` and ``inverse`` belong to the final posture;
    infinity when the Jacobian is singular there.
    """
    jacobian, residual = model.jacobian, model.residual
    n = q.shape[0]
    m = residual.shape[0]
    norm = evaluate(chain, task, goal, q, model)
    before = math.inf
    for step in range(iterations + 1):
        limit_weights(chain, q, is_free, weights)
        if not factor_weighted(jacobian, weights, gram):
            return math.inf
        if norm <= tolerance or step == iterations or (step >= 3 and norm > before):
            break
        # The residual becomes the multipliers; `evaluate` writes the next one over them.
        cholesky_solve(gram, residual)
        largest = 0.0
        for i in range(n):
            value = 0.0
            for a in range(m):
                value += jacobian[a, i] * residual[a]
            inverse[i, 0] = weights[i] * value
            largest = max(largest, abs(inverse[i, 0]))
        scale = 1.0 if largest <= _LARGEST_STEP else _LARGEST_STEP / largest
        for i in range(n):
            q[i] -= scale * inverse[i, 0]
        clamp(chain, q, is_free)
        before = norm
        norm = evaluate(chain, task, goal, q, model)
    if norm > before and norm > tolerance:
        return math.inf
    weighted_inverse(jacobian, weights, gram, inverse)
    return norm


@kernel
def descend(
    chain: ChainArrays,
    task: TaskArrays,
    goal: Array,
    q: Array,
    is_free: NDArray[np.bool_],
    model: LocalModel,
    weights: Array,
    gram: Array,
    trial: Array,
    tolerance: float,
) -> float:
    """Bounded Levenberg-Marquardt from ``q`` (changed) to a local minimum of the residual."""
    wraps, lower, upper = chain.wraps, chain.lower, chain.upper
    jacobian, residual = model.jacobian, model.residual
    n = q.shape[0]
    m = residual.shape[0]
    norm = evaluate(chain, task, goal, q, model)
    damping = 1e-3
    for _ in range(_SEARCH_ITERATIONS):
        if norm <= tolerance:
            break
        scale = 0.0
        for i in range(n):
            weights[i] = 0.0
            if is_free[i]:
                pinned = False
                if not wraps[i] and (q[i] <= lower[i] or q[i] >= upper[i]):
                    slope = 0.0
                    for a in range(m):
                        slope += jacobian[a, i] * residual[a]
                    pinned = (q[i] <= lower[i] and slope > 0.0) or (
                        q[i] >= upper[i] and slope < 0.0
                    )
                if not pinned:
                    weights[i] = 1.0
                    for a in range(m):
                        scale += jacobian[a, i] * jacobian[a, i]
        if scale == 0.0:
            break
        for a in range(m):
            for b in range(a + 1):
                value = damping * scale if a == b else 0.0
                for i in range(n):
                    value += jacobian[a, i] * weights[i] * jacobian[b, i]
                gram[a, b] = value
        if not cholesky(gram):
            damping = max(10.0 * damping, 1e-9)
            continue
        # The residual becomes the multipliers; `evaluate` writes the next one over them.
        cholesky_solve(gram, residual)
        moved = 0.0
        for i in range(n):
            trial[i] = q[i]
            if weights[i] != 0.0:
                value = 0.0
                for a in range(m):
                    value += jacobian[a, i] * residual[a]
                trial[i] -= value
                moved = max(moved, abs(value))
        clamp(chain, trial, is_free)
        after = evaluate(chain, task, goal, trial, model)
        if after < norm:
            gain = norm - after
            for i in range(n):
                q[i] = trial[i]
            damping = max(damping * 0.1, 1e-12)
            stalled = gain < 1e-4 * norm and after > 1e3 * tolerance
            norm = after
            if stalled:
                break
        else:
            damping *= 8.0
            if moved < 1e-9 or damping > 1e8:
                break
            evaluate(chain, task, goal, q, model)
    return norm
