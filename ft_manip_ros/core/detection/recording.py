"""Joint data of a whole run as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Recording:
    """K joint-state messages of n joints.

    Attributes
    ----------
    name
        Where it comes from.
    joints
        Joint names, the columns of all tables.
    stamps : ndarray of int64, shape (K,), ns
    positions, velocities, efforts : ndarray, shape (K, n)
        NaN where not reported (see `present`) or reported as NaN.
    commands : ndarray, shape (K, n)
        Commanded positions at the stamps; NaN where unknown.
    present : ndarray of bool, shape (K, n)
        Whether a message reports a joint's position at all.
    tool : ndarray, shape (K, 3), optional
        Positions of the tool at the stamps, m, in the frame of the arm's base; NaN where not seen.
    """

    name: str
    joints: tuple[str, ...]
    stamps: NDArray[np.int64]
    positions: Array
    velocities: Array
    efforts: Array
    commands: Array
    present: NDArray[np.bool_]
    tool: Array | None = None

    @property
    def times(self) -> Array:
        """Stamps in s, shape (K,)."""
        return np.asarray(self.stamps * 1e-9, dtype=float)

    @property
    def duration(self) -> float:
        """Time between first and last message, s."""
        return float((self.stamps[-1] - self.stamps[0]) * 1e-9) if len(self.stamps) else 0.0

    @property
    def commanded(self) -> NDArray[np.bool_]:
        """Which joints have a command, shape (n,)."""
        return np.asarray(np.isfinite(self.commands).any(axis=0))


def build_recording(
    name: str,
    joints: Sequence[str],
    times: Array,
    positions: Array,
    *,
    velocities: Array | None = None,
    efforts: Array | None = None,
    commands: Array | None = None,
) -> Recording:
    """Recording in which every message reports every joint.

    Parameters
    ----------
    times : ndarray, shape (K,), s
    positions, velocities, efforts, commands : ndarray, shape (K, n)
    """

    def table(values: Array | None) -> Array:
        if values is None:
            return np.full(positions.shape, np.nan)
        return np.ascontiguousarray(values, dtype=float)

    return Recording(
        name,
        tuple(joints),
        np.round(np.asarray(times) * 1e9).astype(np.int64),
        table(positions),
        table(velocities),
        table(efforts),
        table(commands),
        np.ones(positions.shape, dtype=np.bool_),
    )
