"""How the tool that is seen moves with the arm: learned on line from healthy motion.

A tracker or a camera sees some point of the tool, not the one the arm's model ends in, in a frame
that is the arm's base but for a shift, and reports it late:

    seen(t) = x + p(q(t - d)) + R(q(t - d)) y + noise

with p, R the tool's pose by the encoders. Shift x, offset y, delay d and noise are learned by
least squares, one problem for each candidate delay; the delay that leaves the least wins, refined
by a parabola. Nothing needs to be calibrated, and what does not move with the arm (another frame,
another arm) leaves so much unexplained that it is never believed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.kernels import fk_batch

Array = NDArray[np.float64]

DELAYS = np.array([0.0, 0.01, 0.02, 0.03, 0.045, 0.065, 0.09, 0.12, 0.16, 0.2, 0.25])  # s
_MEMORY = 2000.0  # poses
_FIRST = 20  # poses in motion before anything is solved for
_SETTLED = 40  # before its errors say anything
_ENOUGH = 60  # before anything is believed
_EXPLAINED = 0.02  # share of the tool's motion that may stay unexplained, one standard deviation
_LEAST_STEP = 0.002  # m that the tool moves between poses that are learned
_LEAST_NOISE = 1e-4  # m
_OFFSET_PRIOR = 0.2  # m, one standard deviation of y before any is learned
_PRIOR_NOISE = 1e-3  # m, against which the prior is weighed
_STEPS = 4  # of the search for an angle
_NOISE_MEMORY = 50.0  # poses: the first errors are soon forgotten
_OUTLIER = 25.0  # variances: no pose counts for more in the noise


class ToolModel:
    """What is known of the seen tool.

    Parameters
    ----------
    chain
        The arm, n joints; postures are in the order of its joints.

    Attributes
    ----------
    count
        Poses learned so far.
    delay
        s, that explains the poses best.
    noise
        One standard deviation of a coordinate of a seen position, m; inf before any is learned.
    offset : ndarray, shape (3,), m
        y, and ``offset_sigma`` (m) one standard deviation of it.
    """

    def __init__(self, chain: SerialChain) -> None:
        self._chain = chain
        self._normal = np.zeros((len(DELAYS), 6, 6))
        self._right = np.zeros((len(DELAYS), 6))
        self._square = np.zeros(len(DELAYS))
        self._weight = 0.0
        self._seen = np.zeros(3)
        self._seen_square = 0.0
        self._last: Array | None = None
        self._shift: Array = np.zeros(3)
        self._errors = 0
        self._variance = 0.0
        self.count = 0
        self.delay = 0.0
        self.noise = np.inf
        self.offset: Array = np.zeros(3)
        self.offset_sigma = _OFFSET_PRIOR

    @property
    def believed(self) -> bool:
        """Whether the tool was seen to move with the arm, often enough."""
        return self.count >= _ENOUGH and self.noise < _EXPLAINED * self.spread

    @property
    def spread(self) -> float:
        """How far the tool was seen to move, one standard deviation, m."""
        if self._weight <= 0.0:
            return 0.0
        mean = self._seen / self._weight
        variance = self._seen_square / self._weight - float(mean @ mean)
        return float(np.sqrt(max(variance, 0.0)))

    def poses(self, postures: Array) -> tuple[Array, Array]:
        """Rotations (N, 3, 3) and positions (N, 3) by the model for postures (N, n)."""
        rotations = np.empty((len(postures), 3, 3))
        positions = np.empty((len(postures), 3))
        fk_batch(self._chain.arrays, np.ascontiguousarray(postures), rotations, positions)
        return rotations, positions

    def points(self, postures: Array) -> Array:
        """Seen point by the model, less the unknown shift, shape (N, 3), for postures (N, n)."""
        rotations, positions = self.poses(postures)
        return np.asarray(positions + rotations @ self.offset)

    def learn(self, postures: Array, seen: Array) -> None:
        """Take one pose from healthy motion.

        Parameters
        ----------
        postures : ndarray, shape (len(DELAYS) + 1, n)
            By the encoders, at the pose's stamp less each delay, and less ``delay``.
        seen : ndarray, shape (3,), m
        """
        rotations, positions = self.poses(postures)
        if self._last is not None and np.abs(positions[0] - self._last).max() < _LEAST_STEP:
            return
        self._last = positions[0].copy()
        if self.count >= _SETTLED:
            self._learn_noise(seen - positions[-1] - rotations[-1] @ self.offset - self._shift)
        rotations, positions = rotations[:-1], positions[:-1]
        keep = 1.0 - 1.0 / _MEMORY
        away = seen - positions
        turned = np.einsum('dji,dj->di', rotations, away)
        for total in (self._normal, self._right, self._square, self._seen):
            total *= keep
        self._normal[:, :3, :3] += np.eye(3)
        self._normal[:, 3:, 3:] += np.eye(3)
        self._normal[:, :3, 3:] += rotations
        self._normal[:, 3:, :3] += rotations.transpose(0, 2, 1)
        self._right[:, :3] += away
        self._right[:, 3:] += turned
        self._square += (away * away).sum(axis=1)
        self._weight = keep * self._weight + 1.0
        self._seen += seen
        self._seen_square = keep * self._seen_square + float(seen @ seen)
        self.count += 1
        if self.count >= _FIRST:
            self._solve()

    def _solve(self) -> None:
        normal = self._normal.copy()
        prior = (_PRIOR_NOISE / _OFFSET_PRIOR) ** 2
        normal[:, range(6), range(6)] += np.array([1e-12] * 3 + [prior] * 3)
        solved = np.linalg.solve(normal, self._right[:, :, None])[:, :, 0]
        left = np.einsum('dij,dj->di', self._normal, solved) - 2.0 * self._right
        rest = np.maximum(self._square + np.einsum('di,di->d', left, solved), 0.0)
        best = int(np.argmin(rest))
        self.delay = _refined(rest, best)
        # Between two candidates what they leave unexplained passes into shift and offset.
        after = int(np.clip(np.searchsorted(DELAYS, self.delay), 1, len(DELAYS) - 1))
        part = (self.delay - DELAYS[after - 1]) / (DELAYS[after] - DELAYS[after - 1])
        found = solved[after - 1] + part * (solved[after] - solved[after - 1])
        self._shift, self.offset = np.asarray(found[:3]), np.asarray(found[3:])
        noise = max(self.noise, _PRIOR_NOISE) if np.isfinite(self.noise) else _PRIOR_NOISE
        spread = np.trace(np.linalg.inv(normal[best])[3:, 3:]) * noise * noise
        self.offset_sigma = float(np.sqrt(spread))

    def _learn_noise(self, error: Array) -> None:
        """Take what was left unexplained of a pose (3,), m, before it was learned."""
        square = float(error @ error) / 3.0
        if self._errors > _ENOUGH - _SETTLED:
            square = min(square, _OUTLIER * self._variance)
        self._errors += 1
        self._variance += (square - self._variance) / min(self._errors, _NOISE_MEMORY)
        self.noise = max(float(np.sqrt(self._variance)), _LEAST_NOISE)

    def reach(self, posture: Array, joint: int, motion: float) -> Array:
        """Displacement of the seen point, shape (3,), when one joint moves by ``motion``."""
        postures = np.vstack((posture, posture))
        postures[1, joint] += motion
        here, there = self.points(postures)
        return np.asarray(there - here)

    def motion_of(self, posture: Array, joint: int, guess: float, moved: Array) -> float:
        """Motion of one joint (rad or m) that explains the displacement ``moved`` (3,) best."""
        motion = guess
        for _ in range(_STEPS):
            postures = np.vstack((posture, posture, posture))
            step = 1e-4
            postures[1, joint] += motion
            postures[2, joint] += motion + step
            here, there, beyond = self.points(postures)
            slope = (beyond - there) / step
            square = float(slope @ slope)
            if square < 1e-12:
                return 0.0
            motion += float(slope @ (moved - (there - here))) / square
        return motion


def _refined(rest: Array, best: int) -> float:
    """Delay (s) at which the parabola through the three best candidates is least."""
    if not 0 < best < len(DELAYS) - 1:
        return float(DELAYS[best])
    x0, x1, x2 = DELAYS[best - 1 : best + 2]
    s0 = (rest[best] - rest[best - 1]) / (x1 - x0)
    s1 = (rest[best + 1] - rest[best]) / (x2 - x1)
    bend = (s1 - s0) / (x2 - x0)
    if bend <= 0.0:
        return float(x1)
    return float(np.clip(0.5 * (x0 + x1) - 0.5 * s0 / bend, x0, x2))
