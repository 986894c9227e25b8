"""Middle maximisation by marching: the worst frozen angles of one goal and one set of joints.

A grid of frozen angles is swept with warm starts (from the node's own posture of the last
candidate, then from its neighbours); only where a node still fails are random restarts spent, and
those only at the worst node. Its answer is a search aid: what it calls reachable everywhere still
has to be proved by the FTWS engine.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.design.dh_kernels import DhRows, Goals, Limits, Work
from ft_manip_ros.core.design.frozen_sets import FrozenSets, node_angles
from ft_manip_ros.core.design.inner import minimise
from ft_manip_ros.core.design.restarts import MAX_ITERATIONS, RandomState, solve_with_restarts


@njit(cache=True, nogil=True)
def march_goal(
    method: int, rows: DhRows, goals: Goals, goal: int, limits: Limits, sets: FrozenSets,
    postures: Array, give_up: float, zero: float, restarts: int, state: RandomState, work: Work,
    values: Array, worst: Array, worst_postures: Array,
) -> int:  # fmt: skip
    """Worst case of every set of frozen joints for one goal; see `march`.

    Parameters
    ----------
    postures : shape (S, N, n), in and out
    give_up
        Stop once the sum over the sets exceeds this.
    values : shape (N,), scratch
    worst : shape (S,), out
        Penalty at the worst angles of each set; zero for sets not visited.
    worst_postures : shape (S, n), out

    Returns
    -------
    int
        Penalty evaluations.
    """
    evaluations = 0
    total = 0.0
    worst[:] = 0.0
    for subset in range(sets.frozen.shape[0]):
        node, value, used = march(
            method, rows, goals, goal, limits, sets, subset, postures[subset], values,
            give_up - total, zero, restarts, state, work,
        )  # fmt: skip
        evaluations += used
        worst[subset] = value if value > zero else 0.0
        worst_postures[subset] = postures[subset, node]
        total += worst[subset]
        if total > give_up:
            break
    return evaluations


@njit(cache=True, nogil=True)
def march(
    method: int,
    rows: DhRows,
    goals: Goals,
    goal: int,
    limits: Limits,
    sets: FrozenSets,
    subset: int,
    postures: Array,
    values: Array,
    give_up: float,
    zero: float,
    restarts: int,
    state: RandomState,
    work: Work,
) -> tuple[int, float, int]:
    """Penalty over all frozen angles of one set of joints for one goal, and its worst node.

    Parameters
    ----------
    postures : shape (N, n), in and out
        Start and result of every node, N = K**k.
    values : shape (N,), out
        Penalty at every node (m^2 + rad^2); infinity where the sweep gave up before it.
    give_up
        Stop at the first node whose penalty exceeds this even after its restarts.

    Returns
    -------
    node : int
        The worst node visited.
    penalty : float
        There.
    evaluations : int
        Penalty evaluations spent.
    """
    nodes = sets.angles.shape[1]
    order = sets.frozen.shape[1]
    total = values.shape[0]
    free = sets.free[subset]
    trial = np.empty(postures.shape[1])
    evaluations = 0
    for node in range(total):
        values[node] = np.inf
    for node in range(total):
        q = postures[node]
        node_angles(sets, subset, node, q)
        values[node], used = minimise(
            method, rows, goals, goal, limits, free, q, zero, MAX_ITERATIONS, work
        )
        evaluations += used
        stride = 1
        for _ in range(order):
            if values[node] > zero and (node // stride) % nodes > 0:
                evaluations += _borrow(
                    method, rows, goals, goal, limits, sets, subset, postures, values,
                    node, node - stride, zero, work, trial,
                )  # fmt: skip
            stride *= nodes
        if values[node] > give_up:
            values[node], used = solve_with_restarts(
                method, rows, goals, goal, limits, free, q, values[node], zero,
                restarts, state, work, trial,
            )  # fmt: skip
            evaluations += used
            if values[node] > give_up:
                return node, values[node], evaluations
    evaluations += _sweep_back(
        method, rows, goals, goal, limits, sets, subset, postures, values, zero, work, trial
    )
    for _ in range(total):
        worst = int(np.argmax(values))
        if values[worst] <= zero:
            break
        before = values[worst]
        values[worst], used = solve_with_restarts(
            method, rows, goals, goal, limits, free, postures[worst], before, zero,
            restarts, state, work, trial,
        )  # fmt: skip
        evaluations += used
        if values[worst] >= before:
            break
        # A better branch of postures was found: offer it to the nodes on both sides.
        evaluations += _sweep_forward(
            method, rows, goals, goal, limits, sets, subset, postures, values, zero, work, trial
        )
        evaluations += _sweep_back(
            method, rows, goals, goal, limits, sets, subset, postures, values, zero, work, trial
        )
    worst = int(np.argmax(values))
    return worst, values[worst], evaluations


@njit(cache=True, nogil=True)
def _sweep_forward(
    method: int, rows: DhRows, goals: Goals, goal: int, limits: Limits, sets: FrozenSets,
    subset: int, postures: Array, values: Array, zero: float, work: Work, trial: Array,
) -> int:  # fmt: skip
    nodes = sets.angles.shape[1]
    evaluations = 0
    for node in range(values.shape[0]):
        stride = 1
        for _ in range(sets.frozen.shape[1]):
            if values[node] > zero and (node // stride) % nodes > 0:
                evaluations += _borrow(
                    method, rows, goals, goal, limits, sets, subset, postures, values,
                    node, node - stride, zero, work, trial,
                )  # fmt: skip
            stride *= nodes
    return evaluations


@njit(cache=True, nogil=True)
def _sweep_back(
    method: int, rows: DhRows, goals: Goals, goal: int, limits: Limits, sets: FrozenSets,
    subset: int, postures: Array, values: Array, zero: float, work: Work, trial: Array,
) -> int:  # fmt: skip
    nodes = sets.angles.shape[1]
    evaluations = 0
    for node in range(values.shape[0] - 1, -1, -1):
        stride = 1
        for _ in range(sets.frozen.shape[1]):
            if values[node] > zero and (node // stride) % nodes < nodes - 1:
                evaluations += _borrow(
                    method, rows, goals, goal, limits, sets, subset, postures, values,
                    node, node + stride, zero, work, trial,
                )  # fmt: skip
            stride *= nodes
    return evaluations


@njit(cache=True, nogil=True)
def _borrow(
    method: int, rows: DhRows, goals: Goals, goal: int, limits: Limits, sets: FrozenSets,
    subset: int, postures: Array, values: Array, node: int, neighbour: int, zero: float,
    work: Work, trial: Array,
) -> int:  # fmt: skip
    """Try the neighbour's posture as a start at ``node`` where the neighbour does better."""
    if values[neighbour] >= values[node]:
        return 0
    for k in range(trial.shape[0]):
        trial[k] = postures[neighbour, k]
    node_angles(sets, subset, node, trial)
    found, used = minimise(
        method, rows, goals, goal, limits, sets.free[subset], trial, zero, MAX_ITERATIONS, work
    )
    if found < values[node] * (1.0 - 1e-6):
        values[node] = found
        for k in range(trial.shape[0]):
            postures[node, k] = trial[k]
    return used
