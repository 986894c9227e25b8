"""Three-roll wrists: what they leave of the question for every orientation.

Paredis & Khosla (1994) add a zero-length three-roll wrist to their positional template (Table 2).
Let f be the direction of the wrist's first axis, w2 and w3 its other axes, each perpendicular to
the one before, all through the tool's point, and all able to turn fully.

*A joint of the arm fails*: the wrist alone takes any orientation, so the arm has to be fault
tolerant for the position. *A joint of the wrist fails*: suppose that the intact arm reaches the
position with f in any direction. For a tool whose w3 has to point along t,

- the first joint fails: w2 is stuck perpendicular to f. With f along t it is perpendicular to t,
  the second joint turns w3 to t and the third does the rest;
- the second fails: f and t keep an angle. Any f at that angle from t will do: the first joint
  turns w3 to t, the third does the rest;
- the third fails: w2 is fixed in the tool. Any f perpendicular to it will do: the first joint
  turns w2 to its place, the second does the rest.

And the supposition is needed: where the second fails with w3 along f, f has to point along t, and
t is any direction. So a position is a dextrous member of order 1 exactly if it is a member for the
arm without its wrist and f can point anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain

# Sines of angles, and distances relative to the arm, that count as nothing.
_EXACT = 1e-9
_WRIST = 3


@dataclass(frozen=True, eq=False)
class Wrist:
    """A three-roll wrist at the end of an arm.

    Attributes
    ----------
    arm
        The joints before it; its tool is the wrist's point, its tool's z axis the first axis f.
    middle
        Place of the wrist's second joint among the whole arm's.
    along
        Pairs of a position of that joint (rad, within its operating limits) that brings the third
        axis in line with the first one, and 1.0 or -1.0: the same way, or the other way round.
    axis : ndarray, shape (3,)
        The third axis in the tool's frame.
    """

    arm: SerialChain
    middle: int
    along: tuple[tuple[float, float], ...]
    axis: Array


def find_wrist(chain: SerialChain) -> Wrist | None:
    """Return the three-roll wrist of an arm; None if it has none, or only something like it."""
    first = chain.n - _WRIST
    if chain.driven or first < 1 or not all(joint.wraps for joint in chain.joints[first:]):
        return None
    rotation, point = np.eye(3), np.zeros(3)
    axes, points = np.empty((chain.n, 3)), np.empty((chain.n, 3))
    for i in range(chain.n):
        point = point + rotation @ chain.translations[i]
        rotation = rotation @ chain.rotations[i]
        axes[i], points[i] = rotation[:, 2], point
    point = point + rotation @ chain.translations[-1]
    rotation = rotation @ chain.rotations[-1]
    f, w2, w3 = axes[first:]
    scale = float(np.linalg.norm(chain.translations, axis=1).sum())
    lever = point - points[first:]
    off = np.linalg.norm(np.cross(axes[first:], lever), axis=1).max()
    if max(abs(f @ w2), abs(w2 @ w3)) > _EXACT or off > _EXACT * scale:
        return None
    translations = chain.translations[: first + 1].copy()
    before = np.eye(3)
    for turn in chain.rotations[:first]:
        before = before @ turn
    # The tool is moved along the first axis to where all three meet.
    translations[first] += before.T @ (f * (f @ lever[0]))
    arm = replace(
        chain,
        joints=chain.joints[:first],
        rotations=chain.rotations[: first + 1],
        translations=translations,
    )
    middle = first + 1
    straight = float(np.arctan2(w2 @ np.cross(w3, f), w3 @ f))
    lower, upper = chain.joints[middle].operating
    along = []
    for angle, way in ((straight, 1.0), (straight + np.pi, -1.0)):
        angle = float((angle + np.pi) % (2.0 * np.pi) - np.pi)
        if lower <= angle <= upper:
            along.append((angle, way))
    return Wrist(arm, middle, tuple(along), rotation.T @ w3)
