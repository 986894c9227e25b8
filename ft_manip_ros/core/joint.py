"""What moves a chain: joints with their limits, and the axes that follow them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ft_manip_ros.core.errors import InputError

FULL_TURN = 2.0 * np.pi
# Limits given in degrees with few digits still mean a full turn.
_FULL_TURN_SLACK = 1e-6

DEFAULT_VELOCITY = 1.0
DEFAULT_ACCELERATION = 4.0


@dataclass(frozen=True)
class Joint:
    """One joint: name, kind and limits.

    Attributes
    ----------
    name
        Unique within its chain; joint data is always mapped by name.
    lower, upper
        Physical limits (rad or m): what the hardware allows, also after a failure.
    operating_lower, operating_upper
        Operating limits (rad or m): obeyed before a failure, so they bound where the joint can
        freeze. Equal to the physical limits unless given.
    velocity, acceleration
        Largest speed (rad/s or m/s) and acceleration (rad/s^2 or m/s^2).
    prismatic
        True for a sliding joint.
    """

    name: str
    lower: float = -np.pi
    upper: float = np.pi
    operating_lower: float | None = None
    operating_upper: float | None = None
    velocity: float = DEFAULT_VELOCITY
    acceleration: float = DEFAULT_ACCELERATION
    prismatic: bool = False

    def __post_init__(self) -> None:
        where = f'joint {self.name!r}'
        if not self.name:
            raise InputError('joint name', 'is empty; every joint needs a name of its own')
        for key in ('lower', 'upper', 'velocity', 'acceleration'):
            value = getattr(self, key)
            if not np.isfinite(value):
                raise InputError(f'{where}: {key}', f'is {value}; a finite number is needed')
        if not self.lower < self.upper:
            raise InputError(
                f'{where}: limits', f'lower {self.lower:g} is not below upper {self.upper:g}'
            )
        for key in ('velocity', 'acceleration'):
            if getattr(self, key) <= 0.0:
                raise InputError(f'{where}: {key}', f'is {getattr(self, key):g}; must be > 0')
        lo, hi = self.operating
        if not (np.isfinite(lo) and np.isfinite(hi) and lo <= hi):
            raise InputError(f'{where}: operating limits', f'[{lo:g}, {hi:g}] is not an interval')
        if lo < self.lower - 1e-9 or hi > self.upper + 1e-9:
            raise InputError(
                f'{where}: operating limits',
                f'[{lo:g}, {hi:g}] leave the physical limits [{self.lower:g}, {self.upper:g}]',
            )

    @property
    def operating(self) -> tuple[float, float]:
        """Operating limits (rad or m), the physical ones where none were given."""
        lo = self.lower if self.operating_lower is None else self.operating_lower
        hi = self.upper if self.operating_upper is None else self.operating_upper
        return lo, hi

    @property
    def wraps(self) -> bool:
        """True where the physical range is a full turn: its two ends are one posture."""
        return not self.prismatic and self.upper - self.lower >= FULL_TURN - _FULL_TURN_SLACK


@dataclass(frozen=True)
class Axis:
    """One moving axis of a chain: it stands at ``ratio`` times the position of its joint.

    Attributes
    ----------
    name
        Of the axis in the arm's description: its joint's own, or that of one that mimics it.
    joint
        Place of the joint that moves it.
    ratio
        rad or m per rad or m.
    prismatic
        True for a sliding axis.
    offset
        Where the description has the axis when the joint is at 0 (rad or m). The placements
        contain it already.
    """

    name: str
    joint: int
    ratio: float = 1.0
    prismatic: bool = False
    offset: float = 0.0
