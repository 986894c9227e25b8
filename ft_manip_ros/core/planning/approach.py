"""How fast the bodies of an arm can approach each other and what is around them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.planning.bounding import BoundingBodies


def approaches(bodies: BoundingBodies, chain: SerialChain) -> Array:
    """How far the bodies of each pair can approach per joint motion, (P, n), m per rad or 1.

    Only the joints between two bodies move one against the other. Along the line between their
    nearest points the motion about an axis is the same seen from either point, so it is no
    faster than the point that is nearer to the axis.

    Parameters
    ----------
    chain
        The arm, all of whose axes stay within their ranges.
    """
    inward, outward = _swings(bodies, chain.uncoupled)
    axis = bodies.axis
    near = np.minimum(axis[bodies.first], axis[bodies.second])[:, None]
    far = np.maximum(axis[bodies.first], axis[bodies.second])[:, None]
    swapped = axis[bodies.first] > axis[bodies.second]
    lower = np.where(swapped, bodies.second, bodies.first)
    upper = np.where(swapped, bodies.first, bodies.second)
    places = np.arange(inward.shape[1])
    rates = np.minimum(inward[upper], outward[lower]) * ((places > near) & (places <= far))
    motion = np.zeros((len(chain.axes), chain.n))
    for i, moving in enumerate(chain.axes):
        motion[i, moving.joint] = abs(moving.ratio)
    return np.asarray(rates @ motion)


def _swings(bodies: BoundingBodies, chain: SerialChain) -> tuple[Array, Array]:
    """Farthest that a body comes from each axis, (B, N), m: those before its own, those after.

    Of prismatic axes 1: all points go as far. A body is the hull of two balls; each is followed
    from axis to axis in a ball that holds it whatever the joints in between do.
    """
    count = chain.n
    inward, outward = np.zeros((2, len(bodies.axis), count))
    for k, own in enumerate(bodies.axis):
        for end in bodies.ends[k]:
            ball = _Ball(end, end, bodies.radius[k], bodies.radius[k])
            for i in range(own, -1, -1):
                swing, ball = ball.about(chain, i, 1.0)
                inward[k, i] = max(inward[k, i], swing)
                ball = ball.moved(chain.rotations[i], chain.translations[i])
            ball = _Ball(end, end, bodies.radius[k], bodies.radius[k])
            for i in range(own + 1, count):
                back = chain.rotations[i].T
                ball = ball.moved(back, -back @ chain.translations[i])
                swing, ball = ball.about(chain, i, -1.0)
                outward[k, i] = max(outward[k, i], swing)
    return inward, outward


@dataclass(frozen=True)
class _Ball:
    """Two balls that both hold what is followed: one keeps near the axes, one near the joints."""

    axial: Array
    central: Array
    axial_radius: float
    central_radius: float

    def about(self, chain: SerialChain, i: int, sign: float) -> tuple[float, _Ball]:
        """Farthest from axis i, and what holds the same at any position of that joint."""
        if chain.axes[i].prismatic:
            low, high = sorted((sign * chain.lower[i], sign * chain.upper[i]))
            way = np.array([0.0, 0.0, 0.5 * (low + high)])
            room = 0.5 * (high - low)
            return 1.0, _Ball(
                self.axial + way,
                self.central + way,
                self.axial_radius + room,
                self.central_radius + room,
            )
        off = float(np.hypot(*self.axial[:2])) + self.axial_radius
        swing = min(off, float(np.hypot(*self.central[:2])) + self.central_radius)
        centre = np.array([0.0, 0.0, self.axial[2]])
        reach = float(np.linalg.norm(self.central)) + self.central_radius
        return swing, _Ball(centre, np.zeros(3), off, reach)

    def moved(self, rotation: Array, translation: Array) -> _Ball:
        """Seen from another frame."""
        return replace(
            self,
            axial=rotation @ self.axial + translation,
            central=rotation @ self.central + translation,
        )
