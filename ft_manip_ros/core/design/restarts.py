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


@njit(cache=True, nogil=True, error_model='numpy')
def uniform(state: RandomState) -> float:
    """Next number in [0, 1) of the splitmix64 stream whose state is ``state[0]``."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@njit(cache=True, nogil=True, error_model='numpy')
def random_posture(
    limits: Limits, free: IntArray, start: Array, state: RandomState, posture: Array
) -> None:
    """Write ``start`` with its free joints drawn anew within their limits into ``posture``."""
    for k in range(start.shape[0]):
        posture[k] = start[k]
    for k in range(free.shape[0]):
        j = free[k]
        posture[j] = limits.lower[j] + uniform(state) * (limits.upper[j] - limits.lower[j])


@njit(cache=True, nogil=True, error_model='numpy')
def solve_with_restarts(
    method: int,
    rows: DhRows,
    goals: Goals,
    goal: int,
    limits: Limits,
    free: IntArray,
    posture: Array,
    zero: float,
    restarts: int,
    state: RandomState,
    work: Work,
    trial: Array,
) -> tuple[float, int]:
    """Minimise from ``posture``, then from random starts until the penalty is zero.

    Parameters
    ----------
    posture : shape (n,), in and out
        Start, and the best posture found.
    trial : shape (n,), scratch

    Returns
    -------
    penalty : float
        At ``posture``. Where it is zero, ``work`` describes ``posture``.
    evaluations : int
    """
    best = np.inf
    evaluations = 0
    for k in range(posture.shape[0]):
        trial[k] = posture[k]
    for attempt in range(restarts + 1):
        if attempt > 0:
            random_posture(limits, free, posture, state, trial)
        value, used = minimise(
            method, rows, goals, goal, limits, free, trial, zero, MAX_ITERATIONS, work
        )
        evaluations += used
        if value < best * (1.0 - 1e-6):
            best = value
            for k in range(posture.shape[0]):
                posture[k] = trial[k]
        if best <= zero:
            break
    return best, evaluations
