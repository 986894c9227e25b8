"""Where a map lies: a slice, a half plane of revolution, or a volume."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError

_AXES = {'x': 0, 'y': 1, 'z': 2}
GRIDS = ('xy', 'xz', 'yz', 'rz', 'xyz')
# A point this near (m) to a slice is in it.
_IN_PLANE = 1e-9


@dataclass(frozen=True, eq=False)
class MapFrame:
    """Map coordinates: points are ``origin + coordinates @ directions``.

    Attributes
    ----------
    kind
        One of ``GRIDS``. ``'rz'``: radius about and height along the first joint's axis, for
        arms whose first joint turns fully; the FTWS is then a solid of revolution.
    origin : ndarray, shape (3,)
        m.
    directions : ndarray, shape (d, 3)
        Orthonormal.
    """

    kind: str
    origin: Array
    directions: Array

    @property
    def dimension(self) -> int:
        """Number of map coordinates, 2 or 3."""
        return len(self.directions)

    @property
    def unit(self) -> str:
        """Unit of what a map measures: of an area, or of a volume (also a solid of revolution)."""
        return 'm^2' if self.kind in ('xy', 'xz', 'yz') else 'm^3'

    def points(self, coordinates: Array) -> Array:
        """Points (N, 3) of map coordinates (N, d)."""
        return self.origin + coordinates @ self.directions

    def coordinates(self, point: Sequence[float]) -> tuple[float, ...] | None:
        """Map coordinates of a point, or None where the map does not speak of it."""
        x = float(point[0]) - self._origin[0]
        y = float(point[1]) - self._origin[1]
        z = float(point[2]) - self._origin[2]
        along = [x * d[0] + y * d[1] + z * d[2] for d in self._directions]
        if self.kind == 'xyz':
            return tuple(along)
        rest = x * x + y * y + z * z
        if self.kind == 'rz':
            return math.sqrt(max(rest - along[1] * along[1], 0.0)), along[1]
        off = rest - sum(value * value for value in along)
        return tuple(along) if off <= _IN_PLANE**2 + 1e-15 * rest else None

    def __post_init__(self) -> None:
        # Plain numbers: a look-up takes microseconds, NumPy scalars would double that.
        object.__setattr__(self, '_origin', [float(value) for value in self.origin])
        object.__setattr__(self, '_directions', [tuple(row) for row in self.directions.tolist()])

    _origin: list[float] = None  # type: ignore[assignment]
    _directions: list[tuple[float, float, float]] = None  # type: ignore[assignment]


def map_frame(chain: SerialChain, kind: str, at: float = 0.0) -> MapFrame:
    """Return the frame of a map.

    Parameters
    ----------
    kind
        ``'xy'``, ``'xz'``, ``'yz'``: slice with the remaining coordinate at ``at`` (m);
        ``'xyz'``: volume; ``'rz'``: half plane through the first joint's axis.

    Raises
    ------
    InputError
        For an unknown kind, and ``'rz'`` for an arm whose first joint does not turn fully.
    """
    if kind not in GRIDS:
        raise InputError('grid', f'is {kind!r}; valid are {", ".join(GRIDS)}')
    if not np.isfinite(at):
        raise InputError('at', f'is {at}; must be finite (m)')
    if kind == 'rz':
        first = chain.joints[0]
        lo, hi = first.operating
        if not first.wraps or hi - lo < 2.0 * np.pi - 1e-6:
            raise InputError('grid', "'rz' needs a first joint that turns and freezes anywhere")
        axis = chain.rotations[0][:, 2]
        return MapFrame(kind, chain.translations[0], np.array([chain.rotations[0][:, 0], axis]))
    origin = np.zeros(3)
    for name, index in _AXES.items():
        if name not in kind:
            origin[index] = at
    return MapFrame(kind, origin, np.eye(3)[[_AXES[name] for name in kind]])
