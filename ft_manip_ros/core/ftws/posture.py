"""Compiled posture finding for the proofs: a Newton corrector and a seeded, bounded LM search.

Nothing here proves anything: postures are only where the covering and the refutation start.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.ftws.local_model import LocalModel, evaluate
from ft_manip_ros.core.ftws.task_map import TaskArrays

# Closer to a limit than this (rad or m), a joint is asked to contribute less.
_LIMIT_ZONE = 0.4
# Least weight of a joint at its limit, so that it can still leave it.
_LEAST_WEIGHT = 1e-4
_LARGEST_STEP = 0.6
_SINGULAR_DAMPING = 1e-8
_SEARCH_ITERATIONS = 60


@njit(cache=True, nogil=True)
def uniform(state: NDArray[np.uint64]) -> float:
    """Next number of a splitmix64 stream in [0, 1); ``state`` (1,) is advanced."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    x = state[0]
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    x = x ^ (x >> np.uint64(31))
    return float(x >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@njit(cache=True, nogil=True)
def cholesky(gram: Array) -> bool:
    """Factor a symmetric positive definite matrix in place (lower triangle)."""
    m = gram.shape[0]
    for i in range(m):
        for j in range(i + 1):
            value = gram[i, j]
            for k in range(j):
                value -= gram[i, k] * gram[j, k]
            if i == j:
                # A pivot lost to cancellation is no pivot.
                if not value > 1e-14 * gram[i, i] or value <= 0.0:
                    return False
                gram[i, i] = math.sqrt(value)
            else:
                gram[i, j] = value / gram[j, j]
    return True


@njit(cache=True, nogil=True)
def cholesky_solve(factor: Array, x: Array) -> None:
    """Solve with the factor of `cholesky`, in place."""
    m = factor.shape[0]
    for i in range(m):
        value = x[i]
        for k in range(i):
            value -= factor[i, k] * x[k]
        x[i] = value / factor[i, i]
    for i in range(m - 1, -1, -1):
        value = x[i]
        for k in range(i + 1, m):
            value -= factor[k, i] * x[k]
        x[i] = value / factor[i, i]


@njit(cache=True, nogil=True)
def limit_weights(chain: ChainArrays, q: Array, is_free: NDArray[np.bool_], out: Array) -> None:
    """Weight of each joint in the pseudo-inverse: 0 frozen, small near a limit, else 1."""
    for i in range(q.shape[0]):
        if not is_free[i]:
            out[i] = 0.0
        elif chain.wraps[i]:
            out[i] = 1.0
        else:
            slack = min(q[i] - chain.lower[i], chain.upper[i] - q[i])
            zone = min(_LIMIT_ZONE, 0.5 * (chain.upper[i] - chain.lower[i]))
            ratio = min(1.0, max(slack, 0.0) / zone)
            out[i] = max(ratio * ratio, _LEAST_WEIGHT)


@njit(cache=True, nogil=True)
def limit_push(lower: float, upper: float, q: float) -> float:
    """Half the derivative of ``-1 / weight`` of `limit_weights`: away from the nearer limit."""
    zone = min(_LIMIT_ZONE, 0.5 * (upper - lower))
    below, above = q - lower, upper - q
    ratio = min(below, above) / zone
    if ratio >= 1.0:
        return 0.0
    push = 1.0 / (zone * max(ratio, 0.05) ** 3)
    return push if below < above else -push


@njit(cache=True, nogil=True)
def weighted_inverse(jacobian: Array, weights: Array, gram: Array, inverse: Array) -> bool:
    """Right inverse ``W J^T (J W J^T)^-1`` into ``inverse`` (n, m); damped where singular.

    ``gram`` (m, m) is left holding the Cholesky factor. False where even damping does not help.
    """
    m, n = jacobian.shape
    for attempt in range(2):
        scale = 0.0
        for a in range(m):
            for b in range(a + 1):
                value = 0.0
                for i in range(n):
                    value += jacobian[a, i] * weights[i] * jacobian[b, i]
                gram[a, b] = value
            scale += gram[a, a]
        if attempt == 1:
            for a in range(m):
                gram[a, a] += _SINGULAR_DAMPING * scale
        if cholesky(gram):
            break
        if attempt == 1:
            return False
    for i in range(n):
        if weights[i] == 0.0:
            for a in range(m):
                inverse[i, a] = 0.0
        else:
            for a in range(m):
                inverse[i, a] = jacobian[a, i] * weights[i]
            cholesky_solve(gram, inverse[i])
    return True


@njit(cache=True, nogil=True)
def clamp(chain: ChainArrays, q: Array, is_free: NDArray[np.bool_]) -> None:
    """Put the free joints within their limits; joints that wrap into [-pi, pi)."""
    for i in range(q.shape[0]):
        if not is_free[i]:
            continue
        if chain.wraps[i]:
            q[i] -= 2.0 * math.pi * math.floor((q[i] + math.pi) / (2.0 * math.pi))
        else:
            q[i] = min(max(q[i], chain.lower[i]), chain.upper[i])


@njit(cache=True, nogil=True)
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

    On return ``model``, ``weights`` and ``inverse`` belong to the final posture; infinity when
    the Jacobian is singular there.
    """
    n = q.shape[0]
    m = model.residual.shape[0]
    norm = evaluate(chain, task, goal, q, model)
    for step in range(iterations + 1):
        limit_weights(chain, q, is_free, weights)
        if not weighted_inverse(model.jacobian, weights, gram, inverse):
            return math.inf
        if norm <= tolerance or step == iterations:
            return norm
        largest = 0.0
        for i in range(n):
            value = 0.0
            for a in range(m):
                value += inverse[i, a] * model.residual[a]
            largest = max(largest, abs(value))
        scale = 1.0 if largest <= _LARGEST_STEP else _LARGEST_STEP / largest
        for i in range(n):
            value = 0.0
            for a in range(m):
                value += inverse[i, a] * model.residual[a]
            q[i] -= scale * value
        clamp(chain, q, is_free)
        before = norm
        norm = evaluate(chain, task, goal, q, model)
        if step >= 2 and norm > before:
            return norm if norm <= tolerance else math.inf
    return norm


@njit(cache=True, nogil=True)
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
    n = q.shape[0]
    m = model.residual.shape[0]
    norm = evaluate(chain, task, goal, q, model)
    damping = 1e-3
    step = np.empty(m)
    for _ in range(_SEARCH_ITERATIONS):
        if norm <= tolerance:
            break
        scale = 0.0
        for i in range(n):
            weights[i] = 0.0
            if is_free[i]:
                slope = 0.0
                for a in range(m):
                    slope += model.jacobian[a, i] * model.residual[a]
                pinned = not chain.wraps[i] and (
                    (q[i] <= chain.lower[i] and slope > 0.0)
                    or (q[i] >= chain.upper[i] and slope < 0.0)
                )
                if not pinned:
                    weights[i] = 1.0
                    for a in range(m):
                        scale += model.jacobian[a, i] * model.jacobian[a, i]
        if scale == 0.0:
            break
        for a in range(m):
            for b in range(a + 1):
                value = damping * scale if a == b else 0.0
                for i in range(n):
                    value += model.jacobian[a, i] * weights[i] * model.jacobian[b, i]
                gram[a, b] = value
            step[a] = model.residual[a]
        if not cholesky(gram):
            damping = max(10.0 * damping, 1e-9)
            continue
        cholesky_solve(gram, step)
        moved = 0.0
        for i in range(n):
            trial[i] = q[i]
            if weights[i] != 0.0:
                value = 0.0
                for a in range(m):
                    value += model.jacobian[a, i] * step[a]
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
