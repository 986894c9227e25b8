"""How hard the engine tries, and what it reports."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.effort import Effort


@dataclass(frozen=True, kw_only=True)
class FtwsSettings:
    """Settings of a query. Budgets count work, not time, so answers never depend on the machine.

    Attributes
    ----------
    tolerance
        Reach tolerance (m): a non-member's worst ROD misses the goal by more than this.
    orientation_tolerance
        The same for the tool's orientation (rad), in poses.
    radius
        Judge the ball of goals of this radius (m) as one: MEMBER means all of it, NON_MEMBER
        none of it.
    intervals
        Work out the tolerated intervals also of non-members (order 1).
    margin
        Work out the proved ball of members (several coverings more).
    restarts
        Random starts of a posture search.
    smallest_step, smallest_gap
        Resolution of the covering (rad or m): a branch is left below the first, an uncovered
        interval is UNDECIDED below the second.
    slab
        First half-width (rad or m) of boxes of simultaneous failures (order > 1).
    boxes
        Branch-and-bound boxes of the last refutation tried; those before get a part of it.
    pieces
        Certificates per combination of failed joints.
    time_budget
        Stop asking after this time (s, 0: never); goals not asked about are UNDECIDED.
    seed
        Of the random starts.
    """

    tolerance: float = 1e-6
    orientation_tolerance: float = 1e-6
    radius: float = 0.0
    intervals: bool = True
    margin: bool = False
    restarts: int = 12
    smallest_step: float = 1e-5
    smallest_gap: float = 1e-4
    slab: float = 0.2
    boxes: int = 200_000
    pieces: int = 100_000
    time_budget: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for key in ('tolerance', 'orientation_tolerance', 'smallest_step', 'smallest_gap', 'slab'):
            value = getattr(self, key)
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(key, f'is {value}; must be a finite number > 0')
        for key in ('radius', 'time_budget'):
            value = getattr(self, key)
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(key, f'is {value}; must be a finite number >= 0')
        for key in ('restarts', 'boxes', 'pieces'):
            if getattr(self, key) < 1:
                raise InputError(key, f'is {getattr(self, key)}; must be at least 1')
        if self.seed < 0:
            raise InputError('seed', f'is {self.seed}; must be >= 0')

    def effort(self, oriented: bool, length: float) -> Effort:
        """Return the settings as the kernels read them.

        Parameters
        ----------
        oriented
            Whether the orientation counts; residuals then mix metres and ``length`` times radians.
        """
        tolerance = self.tolerance
        if oriented:
            # The smallest ball of residuals that holds every residual within both tolerances.
            tolerance = float(np.hypot(self.tolerance, length * self.orientation_tolerance))
        return Effort(
            tolerance,
            float(self.radius),
            int(self.restarts),
            float(self.smallest_step),
            float(self.smallest_gap),
            float(self.slab),
            int(self.boxes),
            int(self.pieces),
            bool(self.intervals),
            int(self.seed),
        )
