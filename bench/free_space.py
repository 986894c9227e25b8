"""Whether a way exists at all: parts of the free postures of a locked arm, on a grid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
from scipy import ndimage

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.ik import solve_ik_batch
from ft_manip_ros.core.ik_settings import IkSettings
from ft_manip_ros.core.planning.collision import CollisionChecker

# Postures of each healthy joint, random starts for the postures of a goal, and joints beyond
# which the grid would have too many postures.
GRID, STARTS = 25, 3000
MOST_JOINTS = 4


class FreeSpace:
    """Connected parts of the postures in which nothing touches.

    Moves between neighbours on the grid are not looked at, so that parts may hang together here
    that do not: where this sees no way, there is none wider than the grid.

    Parameters
    ----------
    frozen
        The locked joint and its position; at most `MOST_JOINTS` others.
    grid
        Postures of each of them.
    """

    def __init__(
        self,
        chain: SerialChain,
        checker: CollisionChecker,
        frozen: Mapping[str, float],
        grid: int = GRID,
    ) -> None:
        self._chain, self._checker, self._grid = chain, checker, grid
        self._mask = np.array([name in frozen for name in chain.joint_names])
        self._at = np.array([frozen.get(name, 0.0) for name in chain.joint_names])
        self._joints = np.flatnonzero(~self._mask)
        axes = np.linspace(chain.lower, chain.upper, grid)[:, self._joints]
        free = np.zeros((grid,) * len(self._joints), dtype=bool)
        q = self._at.copy()
        for index in product(range(grid), repeat=len(self._joints)):
            q[self._joints] = axes[index, range(len(self._joints))]
            free[index] = not checker.touches(q)
        self._parts, _ = ndimage.label(free)

    def connects(self, start: Array, goals: Sequence[Goal]) -> bool:
        """Tell whether every goal has a posture in the part of the start, (n,)."""
        home = self._around(start)
        rng = np.random.default_rng(0)
        for goal in goals:
            starts = rng.uniform(self._chain.lower, self._chain.upper, (STARTS, self._chain.n))
            starts[:, self._mask] = self._at[self._mask]
            found = solve_ik_batch(
                self._chain,
                [goal] * STARTS,
                starts=starts,
                frozen=self._mask,
                settings=IkSettings(restarts=0),
            )
            postures = found.q[found.converged]
            if not any(self._around(q) & home for q in postures if not self._checker.touches(q)):
                return False
        return True

    def _around(self, q: Array) -> set[int]:
        """Parts that the corners of the grid cell around a posture belong to."""
        span = self._chain.upper - self._chain.lower
        cell = ((q - self._chain.lower) / span * (self._grid - 1))[self._joints]
        low = np.clip(cell.astype(int), 0, self._grid - 2)
        corners = product((0, 1), repeat=len(low))
        return {int(self._parts[tuple(low + corner)]) for corner in corners} - {0}
