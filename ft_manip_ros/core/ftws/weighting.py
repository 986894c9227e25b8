"""Compiled right inverse of a Jacobian, weighted so that joints near their limits move less."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel

# Closer to a limit than this (rad or m), a joint is asked to contribute less.
_LIMIT_ZONE = 0.4
# Least weight of a joint at its limit, so that it can still leave it.
_LEAST_WEIGHT = 1e-4
_SINGULAR_DAMPING = 1e-8


@kernel
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


@kernel
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


@kernel
def limit_weights(chain: ChainArrays, q: Array, is_free: NDArray[np.bool_], out: Array) -> None:
    """Weight of each joint in the pseudo-inverse: 0 frozen, small near a limit, else 1."""
    wraps, lower, upper = chain.wraps, chain.lower, chain.upper
    for i in range(q.shape[0]):
        if not is_free[i]:
            out[i] = 0.0
        elif wraps[i]:
            out[i] = 1.0
        else:
            slack = min(q[i] - lower[i], upper[i] - q[i])
            zone = min(_LIMIT_ZONE, 0.5 * (upper[i] - lower[i]))
            ratio = min(1.0, max(slack, 0.0) / zone)
            out[i] = max(ratio * ratio, _LEAST_WEIGHT)


@kernel
def limit_push(lower: float, upper: float, q: float) -> float:
    """Half the derivative of ``-1 / weight`` of `limit_weights`: away from the nearer limit."""
    zone = min(_LIMIT_ZONE, 0.5 * (upper - lower))
    below, above = q - lower, upper - q
    ratio = min(below, above) / zone
    if ratio >= 1.0:
        return 0.0
    push = 1.0 / (zone * max(ratio, 0.05) ** 3)
    return push if below < above else -push


@kernel
def factor_weighted(jacobian: Array, weights: Array, gram: Array) -> bool:
    """Cholesky factor of ``J W J^T`` into ``gram`` (m, m), damped where singular.

    False where even damping does not help.
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
            return True
    return False


@kernel
def weighted_inverse(jacobian: Array, weights: Array, factor: Array, inverse: Array) -> None:
    """Right inverse ``W J^T (J W J^T)^-1`` into ``inverse`` (n, m), from `factor_weighted`."""
    m, n = jacobian.shape
    for i in range(n):
        weight = weights[i]
        for a in range(m):
            value = jacobian[a, i] * weight
            for b in range(a):
                value -= factor[a, b] * inverse[i, b]
            inverse[i, a] = value / factor[a, a]
        for a in range(m - 1, -1, -1):
            value = inverse[i, a]
            for b in range(a + 1, m):
                value -= factor[b, a] * inverse[i, b]
            inverse[i, a] = value / factor[a, a]
