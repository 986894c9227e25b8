"""What the compiled engine is asked and works with: verdicts, effort, one thread's scratch."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ftws.taylor import Scratch, make_scratch

MEMBER, UNDECIDED, NON_MEMBER = 1, 0, -1

_GAPS = 256
_BOXES = 1024
_HARD = 4


class Effort(NamedTuple):
    """How hard to try, and what to report."""

    tolerance: float  # m, of the residual
    radius: float  # m, ball of goals to judge as one
    restarts: int  # random starts of the posture search
    smallest_step: float  # rad or m, give a branch up below this half-width
    smallest_gap: float  # rad or m, give an uncovered interval up below this width
    slab: float  # rad or m, first half-width of the other frozen joints' boxes (order > 1)
    boxes: int  # branch-and-bound boxes per refutation
    pieces: int  # certificate attempts per combination
    intervals: bool  # go on after a refutation, for the tolerated intervals
    seed: int


class Work(NamedTuple):
    """Scratch of one thread."""

    scratch: Scratch
    gaps: Array  # (G, 2 k), boxes of frozen positions still to cover: lower ends, upper ends
    box: Array  # (2, k), the one in hand
    halves: Array  # (k,)
    q: Array  # (n,)
    chosen: Array  # (n,)
    is_free: NDArray[np.bool_]  # (n,)
    frozen_half: Array  # (n,)
    boxes: Array  # (2, S, n)
    hard: Array  # (H, 3), frozen positions where postures were hardest to find
    state: NDArray[np.uint64]  # (1,)


@njit(cache=True, nogil=True)
def make_work(n: int, m: int, k: int, oriented: bool) -> Work:
    """Allocate one thread's scratch for n joints, m equations and k failures."""
    return Work(
        make_scratch(n, m, k, oriented),
        np.zeros((_GAPS, 2 * k)),
        np.zeros((2, k)),
        np.zeros(k),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n, dtype=np.bool_),
        np.zeros(n),
        np.zeros((2, _BOXES, n)),
        np.zeros((_HARD, 3)),
        np.zeros(1, dtype=np.uint64),
    )


@kernel
def start_stream(state: NDArray[np.uint64], seed: int, stream: int) -> None:
    """Begin a stream of random numbers that depends on the question alone."""
    state[0] = np.uint64(seed) * np.uint64(1000003) + np.uint64(stream)


@kernel
def freeze(combo: NDArray[np.int64], is_free: NDArray[np.bool_]) -> None:
    """Mark the joints of a combination as frozen and all others as free."""
    is_free[:] = True
    for j in range(combo.shape[0]):
        is_free[combo[j]] = False


@kernel
def copy(source: Array, target: Array) -> None:
    """Write a vector over another one; a slice would allocate, in case they overlap."""
    for i in range(source.shape[0]):
        target[i] = source[i]
