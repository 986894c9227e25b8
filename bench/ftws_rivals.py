"""Sampled FTWS verdicts to compare the proved ones with: compiled, by SciPy, by IK libraries."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import least_squares

from bench.ik_rivals import Solver
from ft_manip_ros.core.chain import Array, ChainArrays, SerialChain
from ft_manip_ros.core.ftws.local_model import make_model
from ft_manip_ros.core.ftws.posture import descend, uniform
from ft_manip_ros.core.ftws.task_map import TaskArrays
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.kinematics import fk, jacobian

ANGLES = 65
RESTARTS = 10
TOLERANCE = 1e-6


@njit(cache=True, nogil=True)
def sampled_verdicts(
    chain: ChainArrays, task: TaskArrays, goals: Array, verdicts: NDArray[np.int64]
) -> None:
    """Multi-start IK at 65 frozen angles a joint, compiled; 1 found everywhere, -1 not."""
    n = chain.lower.shape[0]
    m = task.position_rows.shape[0]
    model = make_model(n, m)
    weights, gram, trial, q = np.zeros(n), np.zeros((m, m)), np.zeros(n), np.zeros(n)
    is_free = np.ones(n, dtype=np.bool_)
    state = np.zeros(1, dtype=np.uint64)
    for g in range(goals.shape[0]):
        verdicts[g] = 1
        for j in range(n):
            is_free[:] = True
            is_free[j] = False
            for a in range(ANGLES):
                found = False
                for restart in range(RESTARTS):
                    if restart > 0 or a == 0:
                        for i in range(n):
                            u = uniform(state)
                            q[i] = chain.lower[i] + u * (chain.upper[i] - chain.lower[i])
                    q[j] = chain.lower[j] + a / (ANGLES - 1) * (chain.upper[j] - chain.lower[j])
                    residual = descend(
                        chain, task, goals[g], q, is_free, model, weights, gram, trial, 1e-7
                    )
                    if residual <= TOLERANCE:
                        found = True
                        break
                if not found:
                    verdicts[g] = -1
                    break
            if verdicts[g] < 0:
                break


def scipy_verdict(chain: SerialChain, point: Array) -> int:
    """Judge as `sampled_verdicts` does, with ``scipy.optimize.least_squares``."""
    rng = np.random.default_rng(0)
    for j in range(chain.n):
        free = [i for i in range(chain.n) if i != j]
        wraps = chain.arrays.wraps[free]
        low = np.where(wraps, -np.inf, chain.lower[free])
        high = np.where(wraps, np.inf, chain.upper[free])
        q = np.zeros(chain.n)
        for angle in np.linspace(chain.lower[j], chain.upper[j], ANGLES):
            q[j] = angle

            def residual(x: Array, q: Array = q, free: list[int] = free) -> Array:
                q[free] = x
                return fk(chain, q)[1] - point

            def slope(x: Array, q: Array = q, free: list[int] = free) -> Array:
                q[free] = x
                return jacobian(chain, q)[:3, free]

            for _ in range(RESTARTS):
                start = rng.uniform(chain.lower[free], chain.upper[free])
                found = least_squares(residual, start, slope, bounds=(low, high), xtol=1e-12)
                if np.linalg.norm(found.fun) <= TOLERANCE:
                    break
            else:
                return -1
    return 1


def library_verdict(
    chain: SerialChain, point: Array, build: Callable[[SerialChain, Goal], Solver]
) -> tuple[int, float]:
    """Judge as `sampled_verdicts` does, with a library; also the CPU time of its solves (s).

    Each ROD is a robot of the library's own, set up outside of the time. Its own restarts come
    on top of ours: that can only help it to find what is there.
    """
    rng = np.random.default_rng(0)
    goal = Goal(point)
    spent = 0.0
    for j in range(chain.n):
        for angle in np.linspace(chain.lower[j], chain.upper[j], ANGLES):
            rod = chain.freeze({chain.joint_names[j]: float(angle)})
            solve = build(rod, goal)
            found = False
            start = rng.uniform(rod.lower, rod.upper)
            for _ in range(RESTARTS):
                begin = time.process_time()
                q = solve(start)
                spent += time.process_time() - begin
                # The libraries are asked for 1e-5 m.
                inside = ((q >= rod.lower - 1e-9) & (q <= rod.upper + 1e-9)) | rod.arrays.wraps
                found = bool(inside.all() and np.linalg.norm(fk(rod, q)[1] - point) <= 2e-5)
                if found:
                    break
                start = rng.uniform(rod.lower, rod.upper)
            if not found:
                return -1, spent
    return 1, spent
