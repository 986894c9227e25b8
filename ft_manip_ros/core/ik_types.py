"""What the inverse-kinematics kernels share: controls, scratch arrays, random numbers."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.joint import FULL_TURN

# What is asked of the tool: its position, also the direction of its z axis, or its whole frame.
POSITION = 0
AXIS = 1
POSE = 2

# How a descent or a solve ended.
CONVERGED = 0
STALLED = 1
ITERATION_LIMIT = 2
LOCAL_MINIMUM = 3


class IkControl(NamedTuple):
    """What the kernels are told beside chain and goal; `IkSettings` says what each means."""

    tolerance: float  # m
    orientation_tolerance: float  # rad
    weight: float  # m/rad, what an orientation error counts beside a position error
    max_iterations: int  # per descent
    restarts: int


class IkWork(NamedTuple):
    """Scratch arrays of one thread for chains of n joints with N moving axes."""

    axes: Array  # (N, 3)
    origins: Array  # (N, 3), m
    positions: Array  # (N,), of the axes where joints mimic others, rad or m
    wide: Array  # (N, 6), the weighted Jacobian of the axes
    columns: Array  # (n, 6), the weighted Jacobian, one joint a row
    residual: Array  # (6,), position (m), then weighted rotation vector (m)
    rotation: Array  # (3, 3), of the tool
    gram: Array  # (6, 6)
    multiplier: Array  # (6,)
    step: Array  # (n,)
    free: NDArray[np.bool_]  # (n,), joints that the current step may move
    start: Array  # (n,), where the solve began
    best: Array  # (n,), the closest posture of all descents
    trial: Array  # (n,)
    hessian: Array  # (n, n), its strict upper triangle; the factor in the lower one
    diagonal: Array  # (n,), of the Hessian
    pivots: Array  # (n,), of its factor


@njit(cache=True, nogil=True)
def ik_work(n: int, axes: int) -> IkWork:
    """Scratch arrays for chains of ``n`` joints and so many moving axes."""
    return IkWork(
        np.zeros((axes, 3)),
        np.zeros((axes, 3)),
        np.zeros(axes),
        np.zeros((axes, 6)),
        np.zeros((n, 6)),
        np.zeros(6),
        np.zeros((3, 3)),
        np.zeros((6, 6)),
        np.zeros(6),
        np.zeros(n),
        np.zeros(n, dtype=np.bool_),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros((n, n)),
        np.zeros(n),
        np.zeros(n),
    )


@kernel
def splitmix(state: np.uint64) -> np.uint64:
    """Next state of a counter-based generator (splitmix64: one constant is added per draw)."""
    return np.uint64(state) + np.uint64(0x9E3779B97F4A7C15)


@kernel
def uniform(state: np.uint64) -> float:
    """Return the number in [0, 1) that belongs to a state of `splitmix`."""
    z = np.uint64(state)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@kernel
def wrap_near(value: float, near: float, lower: float, upper: float) -> float:
    """Turn a joint that wraps by whole turns: within its limits, then as close as can be."""
    value -= FULL_TURN * math.floor((value - near) / FULL_TURN + 0.5)
    if value < lower:
        value += FULL_TURN * math.ceil((lower - value) / FULL_TURN)
    elif value > upper:
        value -= FULL_TURN * math.ceil((value - upper) / FULL_TURN)
    # A full turn given in rounded degrees may leave the last digit outside.
    return min(max(value, lower), upper)


@kernel
def clip_start(chain: ChainArrays, frozen: NDArray[np.bool_], q: Array, work: IkWork) -> None:
    """Move a start inside the limits (frozen joints stay) and remember it."""
    for i in range(q.shape[0]):
        if not frozen[i] and not chain.wraps[i]:
            q[i] = min(max(q[i], chain.lower[i]), chain.upper[i])
        work.start[i] = q[i]


@kernel
def wrap_all(chain: ChainArrays, frozen: NDArray[np.bool_], q: Array, near: Array) -> None:
    """Apply `wrap_near` to every joint that wraps and is not frozen."""
    for i in range(q.shape[0]):
        if chain.wraps[i] and not frozen[i]:
            q[i] = wrap_near(q[i], near[i], chain.lower[i], chain.upper[i])
