"""Closed form for planar arms without limits: by how much the worst of all RODs reaches a goal.

Joints frozen side by side fuse their links into one rigid group, whose length ranges over
[max(0, 2 longest - sum), sum] with the frozen angles. A group that begins at joint 1 shifts the
base of the rest; with orientation the group of the last free joint, but for the tool's own link,
shifts the goal (section 3.4). What moves between them reaches an annulus, and both the distance
to bridge and the lengths take every value of their ranges: the worst is at their ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.ftws.task_map import Plane, TaskArrays
from ft_manip_ros.core.kinematics import fk

Complex = NDArray[np.complex128]

# Rounding of lengths and distances: absolute (m), and relative to the arm and its place.
_ROUNDING, _RELATIVE = 2e-12, 2e-13


def span(lengths: Sequence[float]) -> tuple[float, float]:
    """Shortest and longest distance (m) between the ends of links at any angles."""
    if not lengths:
        return 0.0, 0.0
    total = float(sum(lengths))
    return max(0.0, 2.0 * float(max(lengths)) - total), total


def groups_of(
    n: int, frozen: Sequence[int], oriented: bool
) -> tuple[list[int], list[list[int]], list[int]]:
    """Links that shift the base, the moving groups of links, and links that shift the goal.

    Parameters
    ----------
    n
        Links; each is moved by the joint of its number.
    frozen
        Joints; not all of them.
    oriented
        Whether the last link keeps a given direction; it is in none of the groups then.
    """
    runs: list[list[int]] = [[]]
    for i in range(n):
        if i not in frozen:
            runs.append([])
        runs[-1].append(i)
    base, groups = runs[0], runs[1:]
    return base, groups, groups.pop()[:-1] if oriented else []


@dataclass(frozen=True, eq=False)
class PlanarForm:
    """A planar arm without limits, as vectors of its plane, and the ranges of its RODs.

    Attributes
    ----------
    oriented
        Whether the orientation counts.
    length
        m that a radian of orientation counts.
    basis : ndarray, shape (2, 3)
        Of the plane; with the normal right-handed.
    tool : ndarray, shape (3, 3)
        The tool's rotation at the zero posture.
    base : ndarray, shape (3,)
        A point of the first axis (m).
    links : ndarray, shape (n,)
        Of the zero posture, as complex numbers (m).
    signs : ndarray, shape (n,)
        1 where a joint turns about the plane's normal, -1 where against it.
    combos : ndarray, shape (C, k)
    shift : ndarray, shape (2, C)
        Least and largest shift of base and goal together (m).
    reach, hole : ndarray, shape (C,)
        Smallest outer and largest inner radius of what the moving groups reach (m; the inner one
        below 0 where there is no hole).
    widest : ndarray, shape (C,)
        Which group makes the hole; -1 where none moves.
    rounding
        Bound of all errors of a distance (m), but for the goal's own coordinates: rounding, and
        what axes that are parallel only nearly do.
    """

    oriented: bool
    length: float
    basis: Array
    tool: Array
    base: Array
    links: Complex
    signs: Array
    combos: NDArray[np.int64]
    shift: Array
    reach: Array
    hole: Array
    widest: NDArray[np.int64]
    rounding: float

    def target(self, goal: Array) -> complex:
        """Where the moving part has to end for a goal row (7,): a point of the plane (m)."""
        flat = self.basis @ (goal[:3] - self.base)
        place = complex(flat[0], flat[1])
        if self.oriented:
            place -= complex(self.links[-1] * np.exp(1j * self.turn(goal)))
        return place

    def turn(self, goal: Array) -> float:
        """Angle (rad) about the normal from the tool's zero posture to a goal row (7,)."""
        w, v = goal[3], goal[4:]
        side = self.tool.T @ self.basis[0]
        carried = side + 2.0 * np.cross(v, np.cross(v, side) + w * side)
        return float(np.arctan2(self.basis[1] @ carried, self.basis[0] @ carried))

    def slacks(self, targets: Complex, filled: Array) -> tuple[Array, NDArray[np.int64], Array]:
        """Slack of the worst ROD: how far a goal can move, in any direction, and be reached.

        Parameters
        ----------
        targets : shape (N,)
            Places of `target` (m).
        filled : shape (N,)
            Holes of at most this radius (m) are none: a posture is that near everywhere in them.

        Returns
        -------
        slack : ndarray, shape (N,)
            m; where it is negative, the worst ROD misses the goal by so much.
        worst : ndarray, shape (N,)
            Which combination.
        inside : ndarray of bool, shape (N,)
            Whether it is the hole that it gets into.
        """
        radius = np.abs(targets)[:, None]
        least, most = self.shift
        outer = self.reach - (radius + most)
        nearest = np.maximum(np.maximum(radius - most, least - radius), 0.0)
        inner = np.where(self.hole > filled[:, None], nearest - self.hole, np.inf)
        both = np.minimum(outer, inner)
        worst = both.argmin(axis=1)
        rows = np.arange(len(targets))
        return both[rows, worst], worst, (inner < outer)[rows, worst]

    def allowance(self, points: Array, off: Array | float) -> Array:
        """Bound (m) of the errors of the slack of goals at points (..., 3).

        ``off`` (...) is their distance off the plane (m): each is judged as the nearest one of
        the plane. With a tilted tool, the length of its link changes a little too.
        """
        weight = 2.0 if self.oriented else 1.0
        allowed: Array = self.rounding + _RELATIVE * np.linalg.norm(points, axis=-1) + weight * off
        return allowed

    @property
    def leverage(self) -> float:
        """How far (m) the target moves for a ball of goals of radius 1 m; 1 without orientation.

        A ball of poses is one of position and ``length`` times orientation together.
        """
        return float(np.hypot(1.0, abs(self.links[-1]) / self.length)) if self.oriented else 1.0


def closed_form_holds(chain: SerialChain, plane: Plane | None) -> bool:
    """Whether all that an arm has are parallel hinges that turn fully, each on its own."""
    return plane is not None and not chain.driven and all(joint.wraps for joint in chain.joints)


def planar_form(
    chain: SerialChain, plane: Plane, task: TaskArrays, combos: NDArray[np.int64]
) -> PlanarForm:
    """Work out the ranges of all RODs of an arm for which `closed_form_holds`."""
    n = chain.n
    origins, axes = np.zeros((n + 1, 3)), np.zeros((n, 3))
    rotation, point = np.eye(3), np.zeros(3)
    for i in range(n):
        point = point + rotation @ chain.translations[i]
        rotation = rotation @ chain.rotations[i]
        origins[i], axes[i] = point, rotation[:, 2]
    origins[n] = point + rotation @ chain.translations[n]
    flat = np.diff(origins, axis=0) @ plane.basis.T
    links = flat[:, 0] + 1j * flat[:, 1]
    lengths = [float(length) for length in np.abs(links)]
    oriented = task.orientation_rows.shape[0] > 0
    count = len(combos)
    shift, reach, hole = np.zeros((2, count)), np.zeros(count), np.zeros(count)
    widest = np.full(count, -1)
    for c, combo in enumerate(combos.tolist()):
        base, groups, tail = groups_of(n, combo, oriented)
        shift[:, c] = span([lengths[i] for i in base + tail])
        ranges = [span([lengths[i] for i in group]) for group in groups]
        shortest = sum(low for low, _ in ranges)
        reach[c] = shortest
        holes = [low + high - shortest for low, high in ranges]
        if holes:
            widest[c] = int(np.argmax(holes))
            hole[c] = holes[widest[c]]
    return PlanarForm(
        oriented, float(task.length), plane.basis, fk(chain, np.zeros(n))[0], origins[0], links,
        np.sign(axes @ plane.normal), combos, shift, reach, hole, widest,
        _ROUNDING + _bend(chain, float(task.length) if oriented else 0.0)
        + _RELATIVE * float(np.linalg.norm(chain.translations, axis=1).sum()),
    )  # fmt: skip


def _bend(chain: SerialChain, length: float) -> float:
    """Bound (m) of how far the tool is from where exactly parallel axes would have it.

    A placement that tilts the next axis, or is no exact rotation, by e moves what comes after it
    by at most 2 e times the length of that, and turns the tool by as much.
    """
    rest = np.cumsum(np.linalg.norm(chain.translations, axis=1)[::-1])[::-1]
    bend = 0.0
    for i, rotation in enumerate(chain.rotations):
        e = float(np.linalg.norm(rotation.T @ rotation - np.eye(3)))
        if 0 < i < chain.n:
            e += float(np.hypot(rotation[0, 2], rotation[1, 2]))
        bend += 2.0 * e * (float(rest[i + 1]) if i < chain.n else 0.0) + 2.0 * e * length
    return bend
