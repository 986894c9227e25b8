"""How the hot kernels are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from numba import njit

_Function = TypeVar('_Function', bound=Callable[..., object])


def kernel(function: _Function) -> _Function:
    """Compile a function that allocates nothing, without counting references to its arrays.

    Numba otherwise counts a reference up and down, both atomically, for every array of a named
    tuple at each look-up of one of its fields: up to nine tenths of the time of a kernel that
    gets its scratch so. The caller holds all arrays for as long as the call takes, so the counts
    are of no use; a function that does allocate is refused when it is compiled.
    """
    compiled: _Function = njit(cache=True, nogil=True, _nrt=False)(function)
    return compiled
