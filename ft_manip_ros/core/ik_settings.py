"""How hard inverse kinematics tries, and what a goal asks of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.ik_types import AXIS, POSE, POSITION, IkControl


@dataclass(frozen=True)
class IkSettings:
    """How hard to try.

    Attributes
    ----------
    tolerance, orientation_tolerance
        A goal counts as reached within these (m, rad).
    max_iterations
        Steps of one descent.
    restarts
        Random starts after the given one; each takes a few microseconds.
    seed
        Of the random starts: same seed, same answer.
    orientation_weight
        What a radian counts beside a metre while the error shrinks (m/rad).
    """

    tolerance: float = 1e-6
    orientation_tolerance: float = 1e-6
    max_iterations: int = 40
    restarts: int = 100
    seed: int = 0
    orientation_weight: float = 0.3

    def __post_init__(self) -> None:
        for key in ('tolerance', 'orientation_tolerance', 'orientation_weight'):
            value = getattr(self, key)
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(f'IK settings: {key}', f'is {value}; must be finite and > 0')
        if self.max_iterations < 1:
            raise InputError('IK settings: max_iterations', 'must be at least 1')
        if self.restarts < 0:
            raise InputError('IK settings: restarts', 'must be at least 0')
        if not 0 <= self.seed < 2**63:
            raise InputError('IK settings: seed', f'is {self.seed}; must be in 0 ... 2^63 - 1')


def ik_control(settings: IkSettings) -> IkControl:
    """Return the settings as the kernels read them."""
    return IkControl(
        float(settings.tolerance),
        float(settings.orientation_tolerance),
        float(settings.orientation_weight),
        int(settings.max_iterations),
        int(settings.restarts),
    )


def ik_mode(goal: Goal) -> int:
    """Return which kernel mode a goal asks for."""
    if goal.orientation is None:
        return POSITION
    return AXIS if goal.free_axis else POSE
