"""Volumes around a goal that have to be reached whole: boxes and spheres of points."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import product

import numpy as np

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.errors import InputError

_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
_FACES = np.concatenate([np.eye(3), -np.eye(3)])


class Region(ABC):
    """A volume whose centre is the goal's position, edges along the axes of the base frame."""

    @property
    @abstractmethod
    def half(self) -> Array:
        """Half edges of the smallest box around it, shape (3,), m."""

    @property
    @abstractmethod
    def inner_radius(self) -> float:
        """Radius of the largest ball inside it, m."""

    @abstractmethod
    def surface(self) -> Array:
        """Points of its surface in all directions, from the centre, shape (14, 3), m."""

    @abstractmethod
    def nearest(self, center: Array, half: Array) -> Array | None:
        """Point of this region in a cell: the cell's centre, where that is not outside.

        Parameters
        ----------
        center, half : shape (3,)
            The cell: a box, from the region's centre, m.

        Returns
        -------
        ndarray, shape (3,), or None
            From the region's centre, m; None where the cell lies outside.
        """

    @abstractmethod
    def __str__(self) -> str:
        """Return its kind and size, for a person."""


@dataclass(frozen=True)
class Box(Region):
    """A box with edges of ``size`` (x, y, z), m."""

    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        if len(self.size) != 3 or not all(np.isfinite(e) and e > 0.0 for e in self.size):
            raise InputError('size', f'is {self.size}; must be three finite numbers > 0 (m)')

    @property
    def half(self) -> Array:
        """See `Region.half`."""
        return 0.5 * np.array(self.size)

    @property
    def inner_radius(self) -> float:
        """See `Region.inner_radius`."""
        return 0.5 * min(self.size)

    def surface(self) -> Array:
        """See `Region.surface`."""
        return np.concatenate([_CORNERS, _FACES]) * self.half

    def nearest(self, center: Array, half: Array) -> Array | None:
        """See `Region.nearest`."""
        if (np.abs(center) > self.half + half).any():
            return None
        closest: Array = np.clip(center, -self.half, self.half)
        return closest

    def __str__(self) -> str:
        return 'box of {:g} x {:g} x {:g} m'.format(*self.size)


@dataclass(frozen=True)
class Sphere(Region):
    """A ball of ``radius`` (m)."""

    radius: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.radius) and self.radius > 0.0):
            raise InputError('radius', f'is {self.radius}; must be a finite number > 0 (m)')

    @property
    def half(self) -> Array:
        """See `Region.half`."""
        return np.full(3, self.radius)

    @property
    def inner_radius(self) -> float:
        """See `Region.inner_radius`."""
        return self.radius

    def surface(self) -> Array:
        """See `Region.surface`."""
        return self.radius * np.concatenate([_CORNERS / np.sqrt(3.0), _FACES])

    def nearest(self, center: Array, half: Array) -> Array | None:
        """See `Region.nearest`."""
        if np.linalg.norm(center) <= self.radius:
            return center
        closest: Array = np.clip(np.zeros(3), center - half, center + half)
        return closest if np.linalg.norm(closest) <= self.radius else None

    def __str__(self) -> str:
        return f'ball of {self.radius:g} m'
