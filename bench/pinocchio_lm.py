"""The project's position IK, step by step the same, on Pinocchio calls and NumPy: a baseline."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.ik_position import DAMPING, FLOOR, RATIO, WINDOW
from ft_manip_ros.core.pinocchio_model import TOOL_FRAME

_IDENTITY = np.eye(3)


class PinocchioLm:
    """Levenberg-Marquardt with restarts on one reduced model (the ROD, frozen joints removed)."""

    def __init__(self, model: Any, tolerance: float, max_iterations: int, restarts: int) -> None:
        self.model = model
        self.data = model.createData()
        self.tool = model.getFrameId(TOOL_FRAME)
        self.lower = model.lowerPositionLimit
        self.upper = model.upperPositionLimit
        self.tolerance = tolerance
        self.max_iterations = max_iterations
        self.restarts = restarts

    def position(self, q: Array) -> Array:
        """Tool position (3,), m."""
        pinocchio.forwardKinematics(self.model, self.data, q)
        return pinocchio.updateFramePlacement(self.model, self.data, self.tool).translation

    def linear_jacobian(self, q: Array) -> Array:
        """Linear rows of the Jacobian (3, n) at ``q``, whose position was computed last."""
        return pinocchio.computeFrameJacobian(
            self.model, self.data, q, self.tool, pinocchio.LOCAL_WORLD_ALIGNED
        )[:3]

    def descend(self, q: Array, target: Array) -> tuple[bool, Array, int]:
        """One descent; returns whether it converged, where it ended and its steps."""
        mark = np.inf
        steps, judged = 0, 0
        while True:
            error = target - self.position(q)
            cost = float(error @ error)
            if cost <= self.tolerance**2:
                return True, q, steps
            if steps == judged:
                if not cost <= RATIO * mark:
                    return False, q, steps
                mark = cost
                judged += WINDOW
            if steps >= self.max_iterations:
                return False, q, steps
            steps += 1
            jacobian = self.linear_jacobian(q)
            gradient = jacobian.T @ error
            free = ~((q <= self.lower) & (gradient < 0.0) | (q >= self.upper) & (gradient > 0.0))
            damped = (DAMPING * cost + FLOOR) * _IDENTITY
            step = np.zeros_like(q)
            left = error
            for _ in range(len(q)):
                columns = jacobian[:, free]
                step[free] = columns.T @ np.linalg.solve(columns @ columns.T + damped, left)
                moved = q + step
                crossed = free & ((moved < self.lower) | (moved > self.upper))
                if not crossed.any():
                    break
                step[crossed] = np.clip(moved, self.lower, self.upper)[crossed] - q[crossed]
                free &= ~crossed
                left = error - jacobian[:, ~free] @ step[~free]
            q = np.clip(q + step, self.lower, self.upper)

    def solve(
        self, start: Array, target: Array, rng: np.random.Generator
    ) -> tuple[bool, Array, int]:
        """Descend from the start, then from random postures, until one converges."""
        converged, q, total = self.descend(start, target)
        for _ in range(self.restarts):
            if converged:
                break
            converged, q, steps = self.descend(rng.uniform(self.lower, self.upper), target)
            total += steps
        return converged, q, total
