"""Constant placements split so that the kernels turn about z and x only."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Below this sine of the twist two axes count as parallel and the split of the rest is free.
_PARALLEL = 1e-12


def split_rotation(rotation: Array) -> tuple[float, float, float, float]:
    """Return (a, cos alpha, sin alpha, b) with ``rotation`` = Rz(a) Rx(alpha) Rz(b).

    Always possible and well conditioned, unlike the common normal of DH parameters, which is
    lost for nearly parallel axes.
    """
    sine = math.hypot(rotation[0, 2], rotation[1, 2])
    if sine < _PARALLEL:
        sign = math.copysign(1.0, rotation[2, 2])
        return math.atan2(rotation[1, 0], rotation[0, 0]), sign, 0.0, 0.0
    a = math.atan2(rotation[0, 2], -rotation[1, 2])
    b = math.atan2(rotation[2, 0], rotation[2, 1])
    return a, float(rotation[2, 2]), sine, b


def screw_form(rotations: Array, translations: Array) -> Array:
    """Rewrite a chain's placements for the kernels.

    Rotations about a joint's own axis commute with its motion. So every inner placement
    Rz(a) Rx(alpha) Rz(b) gives its outer factors to the joints beside it, as constant offsets,
    and only the twist alpha is left: 12 products instead of 27 for each joint.

    Parameters
    ----------
    rotations : shape (n+1, 3, 3)
    translations : shape (n+1, 3)
        Constant placements of a `SerialChain` (m).

    Returns
    -------
    ndarray, shape (n, 6)
        Per joint: offset (rad) added to its turn, cos and sin of the twist after it, and the
        translation after it (m) in the turned frame. The tool's rotation stays apart: after
        the last joint the twist is zero and ``rotations[n]`` applies.
    """
    n = len(rotations) - 1
    rows = np.zeros((n, 6))
    carried = 0.0
    for i in range(n):
        a, cosine, sine, b = 0.0, 1.0, 0.0, 0.0
        if i < n - 1:
            a, cosine, sine, b = split_rotation(rotations[i + 1])
        x, y, z = translations[i + 1]
        c, s = math.cos(a), math.sin(a)
        rows[i] = carried + a, cosine, sine, c * x + s * y, c * y - s * x, z
        carried = b
    return rows
