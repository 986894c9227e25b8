"""Random restarts of the inner minimisation, from a counter-based stream of random numbers."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.design.dh_kernels import DhRows, Goals, IntArray, Limits, Work
from ft_manip_ros.core.design.inner import minimise

# Enough for Newton's method from anywhere; LM and the hybrid stop short only out of reach.
MAX_ITERATIONS = 60

RandomState = NDArray[np.uint64]


def random_state(rng: np.random.Generator) -> RandomState:
    """Return the state of a fresh stream for the kernels, drawn from ``rng``."""
    return np.array([rng.integers(2**63)], dtype=np.uint64)


@njit(cache=True, nogil=True)
def uniform(state: RandomState) -> float:
    """Next number in [0, 1) of the splitmix64 stream whose state is ``state[0]``."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@njit(cache=True, nogil=True)
def solve_with_restarts(
    method: int,
    rows: DhRows,
    goals: Goals,
    goal: int,
    limits: Limits,
    free: IntArray,
    best: Array,
    value: float,
    zero: float,
    restarts: int,
    state: RandomState,
    work: Work,
    trial: Array,
) -> tuple[float, int]:
    """Improve posture ``best`` (penalty ``value``) from random starts until it is zero."""
    evaluations = 0
    for _ in range(restarts):
        if value <= zero:
            break
        for k in range(best.shape[0]):
            trial[k] = best[k]
        for k in range(free.shape[0]):
            j = free[k]
            trial[j] = limits.lower[j] + uniform(state) * (limits.upper[j] - limits.lower[j])
        found, used = minimise(
            method, rows, goals, goal, limits, free, trial, zero, MAX_ITERATIONS, work
        )
        evaluations += used
        if found < value * (1.0 - 1e-6):
            value = found
            for k in range(best.shape[0]):
                best[k] = trial[k]
    return value, evaluations
