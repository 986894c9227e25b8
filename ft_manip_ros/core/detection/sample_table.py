"""Samples by joint names, as tables of all watched joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def sample_table(
    place: Mapping[str, int],
    names: Sequence[str],
    positions: Array,
    velocities: Array,
    efforts: Array,
) -> tuple[Array, NDArray[np.bool_]]:
    """Sort K messages of the same m joints into the columns of n watched ones.

    Parameters
    ----------
    place
        Column of each watched joint.
    names
        Joints of the columns given; unknown ones are left out.
    positions, velocities, efforts : ndarray, shape (K, m), or (K, 0) where not given

    Returns
    -------
    values : ndarray, shape (3, K, n)
        Positions, velocities and efforts, NaN where not given.
    present : ndarray of bool, shape (K, n)
        Which joints have a position.
    """
    columns = [k for k, name in enumerate(names) if name in place]
    places = [place[names[k]] for k in columns]
    values = np.full((3, len(positions), len(place)), np.nan)
    present = np.zeros((len(positions), len(place)), dtype=np.bool_)
    for row, table in enumerate((positions, velocities, efforts)):
        if table.shape[1]:
            values[row][:, places] = table[:, columns]
    present[:, places] = positions.shape[1] > 0
    return values, present
