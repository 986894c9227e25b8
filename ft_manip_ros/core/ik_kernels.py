"""Compiled bounded inverse kinematics with restarts, for one goal or many.

Frozen joints are a mask over the full chain, so that a kernel which sweeps frozen angles builds
nothing per angle. Nothing here allocates; `ik_types.ik_work` makes the scratch arrays once.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ik_pose import descend_pose
from ft_manip_ros.core.ik_position import descend_position
from ft_manip_ros.core.ik_settle import settle
from ft_manip_ros.core.ik_types import (
    CONVERGED,
    POSITION,
    IkControl,
    IkWork,
    clip_start,
    ik_work,
    splitmix,
    uniform,
    wrap_all,
)


@kernel
def descend(
    chain: ChainArrays,
    frozen: NDArray[np.bool_],
    mode: int,
    target: Array,
    rotation: Array,
    control: IkControl,
    q: Array,
    work: IkWork,
) -> tuple[int, int, float, float]:
    """Make one fast descent from ``q`` (n,), in place.

    Parameters
    ----------
    frozen : shape (n,)
        True for joints that stay exactly where ``q`` has them, inside their limits or not.
    mode
        `POSITION`, `AXIS` or `POSE`.
    target : shape (3,)
        Position of the tool (m, base frame).
    rotation : shape (3, 3)
        Of the tool; not read in mode `POSITION`.

    Returns
    -------
    status
        `CONVERGED`, `STALLED` or `ITERATION_LIMIT`.
    steps
        Steps taken.
    position_error, orientation_error
        m and rad at the final ``q``, which is inside the limits.
    """
    clip_start(chain, frozen, q, work)
    if mode == POSITION and chain.driver.shape[0] == 0:
        status, steps, distance = descend_position(chain, frozen, target, control, q, work)
        angle = 0.0
    else:
        status, steps, distance, angle = descend_pose(
            chain, frozen, mode, target, rotation, control, q, work
        )
    wrap_all(chain, frozen, q, work.start)
    return status, steps, distance, angle


@kernel
def solve(
    chain: ChainArrays,
    frozen: NDArray[np.bool_],
    mode: int,
    target: Array,
    rotation: Array,
    control: IkControl,
    seed: int,
    q: Array,
    work: IkWork,
) -> tuple[int, int, int, float, float]:
    """Solve one goal from the start ``q`` (n,), then from random starts; ``q`` gets the answer.

    Parameters as `descend`. Where nothing converges, the closest posture of all descents is
    settled into its local minimum.

    Returns
    -------
    status
        `CONVERGED`, `LOCAL_MINIMUM` or `ITERATION_LIMIT`; the latter two prove nothing about
        whether the goal can be reached.
    steps, restarts
        Steps of all descents together, and random starts used.
    position_error, orientation_error
        m and rad at the final ``q``.
    """
    n = q.shape[0]
    state = np.uint64(seed)
    total = 0
    least = np.inf
    clip_start(chain, frozen, q, work)
    for attempt in range(control.restarts + 1):
        if attempt > 0:
            for i in range(n):
                state = splitmix(state)
                if not frozen[i]:
                    q[i] = chain.lower[i] + uniform(state) * (chain.upper[i] - chain.lower[i])
        if mode == POSITION and chain.driver.shape[0] == 0:
            status, steps, distance = descend_position(chain, frozen, target, control, q, work)
            angle = 0.0
        else:
            status, steps, distance, angle = descend_pose(
                chain, frozen, mode, target, rotation, control, q, work
            )
        total += steps
        if status == CONVERGED:
            wrap_all(chain, frozen, q, work.start)
            return CONVERGED, total, attempt, distance, angle
        cost = distance * distance + (control.weight * angle) ** 2
        if cost < least or attempt == 0:
            least = cost
            for i in range(n):
                work.best[i] = q[i]
    for i in range(n):
        q[i] = work.best[i]
    status, steps, distance, angle = settle(
        chain, frozen, mode, target, rotation, control, q, work
    )
    wrap_all(chain, frozen, q, work.start)
    return status, total + steps, control.restarts, distance, angle


@njit(cache=True, nogil=True)
def solve_rows(
    chain: ChainArrays,
    frozen: NDArray[np.bool_],
    modes: NDArray[np.int64],
    targets: Array,
    rotations: Array,
    control: IkControl,
    seeds: NDArray[np.uint64],
    qs: Array,
    counts: NDArray[np.int64],
    errors: Array,
) -> None:
    """Solve a batch, one problem a row, each independent of all others.

    Parameters
    ----------
    frozen : shape (N, n)
    modes : shape (N,)
    targets : shape (N, 3)
    rotations : shape (N, 3, 3)
    seeds : shape (N,)
    qs : shape (N, n), in and out
        Starts, then answers.
    counts : shape (N, 3), out
        Status, steps, restarts.
    errors : shape (N, 2), out
        Position error (m) and orientation error (rad).
    """
    work = ik_work(qs.shape[1], chain.screws.shape[0])
    for k in range(qs.shape[0]):
        status, steps, restarts, distance, angle = solve(
            chain, frozen[k], modes[k], targets[k], rotations[k], control, seeds[k], qs[k], work
        )
        counts[k, 0], counts[k, 1], counts[k, 2] = status, steps, restarts
        errors[k, 0], errors[k, 1] = distance, angle
