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
from ft_manip_ros.core.design.restarts import MAX_ITERATIONS, RandomState, random_posture

# Phases of a march: every node from its own posture and its lower neighbours; from the upper
# neighbours; the worst node from random starts; and, where that helped, from the lower ones again.
_FIRST, _BACKWARD, _RESTART, _FORWARD = 0, 1, 2, 3


@njit(cache=True, nogil=True, error_model='numpy')
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


@njit(cache=True, nogil=True, error_model='numpy')
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
    total = values.shape[0]
    trial = np.empty(postures.shape[1])
    values[:] = np.inf
    phase, node = _FIRST, 0
    evaluations = 0
    while True:
        before = values[node]
        evaluations += _visit(
            method, rows, goals, goal, limits, sets, subset, postures, values, node, phase,
            give_up, zero, restarts, state, work, trial,
        )  # fmt: skip
        if phase == _FIRST:
            if values[node] > give_up:
                return node, values[node], evaluations
            node += 1
            if node == total:
                phase, node = _BACKWARD, total - 1
        elif phase == _FORWARD:
            node += 1
            if node == total:
                phase, node = _BACKWARD, total - 1
        elif phase == _BACKWARD:
            node -= 1
            if node < 0:
                phase, node = _RESTART, int(np.argmax(values))
                if values[node] <= zero:
                    break
        elif values[node] < before:
            # A better branch of postures was found: offer it to the nodes on both sides.
            phase, node = _FORWARD, 0
        else:
            break
    return node, values[node], evaluations


@njit(cache=True, nogil=True, error_model='numpy')
def _visit(
    method: int, rows: DhRows, goals: Goals, goal: int, limits: Limits, sets: FrozenSets,
    subset: int, postures: Array, values: Array, node: int, phase: int, give_up: float,
    zero: float, restarts: int, state: RandomState, work: Work, trial: Array,
) -> int:  # fmt: skip
    """Try to lower the penalty of one node from the starts that belong to ``phase``.

    The starts are numbered: the node's own posture, its lower neighbours, its upper neighbours
    (one of each per frozen joint), random ones. One loop over them keeps the compiled code to a
    single copy of the minimisation.
    """
    nodes = sets.angles.shape[1]
    order = sets.frozen.shape[1]
    free = sets.free[subset]
    evaluations = 0
    for start in range(1 + 2 * order + restarts):
        if values[node] <= zero:
            break
        if start == 0:
            if phase != _FIRST:
                continue
            for k in range(trial.shape[0]):
                trial[k] = postures[node, k]
        elif start <= 2 * order:
            backward = start > order
            if phase == _RESTART or backward != (phase == _BACKWARD):
                continue
            stride = nodes ** ((start - 1) % order)
            place = (node // stride) % nodes
            if place == (nodes - 1 if backward else 0):
                continue
            neighbour = node + stride if backward else node - stride
            if values[neighbour] >= values[node]:
                continue
            for k in range(trial.shape[0]):
                trial[k] = postures[neighbour, k]
        else:
            if phase != _RESTART and not (phase == _FIRST and values[node] > give_up):
                break
            random_posture(limits, free, postures[node], state, trial)
        node_angles(sets, subset, node, trial)
        value, used = minimise(
            method, rows, goals, goal, limits, free, trial, zero, MAX_ITERATIONS, work
        )
        evaluations += used
        if value < values[node] * (1.0 - 1e-6):
            values[node] = value
            for k in range(trial.shape[0]):
                postures[node, k] = trial[k]
    return evaluations
