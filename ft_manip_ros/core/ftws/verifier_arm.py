"""The verifier's own kinematics: batched NumPy, written from the chain's definition alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Derivatives(NamedTuple):
    """The residual of N postures and its derivatives; n joints, m equations.

    Attributes
    ----------
    residual : shape (N, m)
        m; rows of the orientation are metres too, by the arm's length scale.
    jacobian : shape (N, m, n)
    hessian : shape (N, m, n, n)
    distance : shape (N, n)
        Of the tool from each axis (m); of slides unused.
    """

    residual: Array
    jacobian: Array
    hessian: Array
    distance: Array


class Arm:
    """Serial chain of a certificate and what its goals ask.

    Parameters
    ----------
    data
        The certificate's ``arm`` entry: joints, rotations (n+1, 3, 3), translations (n+1, 3).
    mode
        ``'position'`` or ``'pose'``.
    tolerance, orientation_tolerance
        m and rad.
    """

    def __init__(
        self, data: Mapping[str, Any], mode: str, tolerance: float, orientation_tolerance: float
    ) -> None:
        joints = data['joints']
        self.names = [joint['name'] for joint in joints]
        self.n = len(joints)
        self.prismatic = np.array([bool(joint['prismatic']) for joint in joints])
        self.lower = np.array([joint['lower'] for joint in joints], float)
        self.upper = np.array([joint['upper'] for joint in joints], float)
        self.operating = np.array([joint['operating'] for joint in joints], float).T
        self.fails = [bool(joint['fails']) for joint in joints]
        self.wraps = ~self.prismatic & (self.upper - self.lower >= 2.0 * np.pi - 1e-6)
        self.rotations = np.array(data['rotations'], float)
        self.translations = np.array(data['translations'], float)
        self.oriented = mode == 'pose'
        lengths = np.linalg.norm(self.translations[1:], axis=1).sum()
        self.length = 0.5 * lengths if self.oriented else 0.0
        self.tolerance = float(np.hypot(tolerance, self.length * orientation_tolerance))
        self.normal = self._normal()
        self.rows = self._rows()

    def index(self, name: str) -> int:
        """Place of a joint by name."""
        return self.names.index(name)

    def combos(self, order: int) -> list[list[int]]:
        """Every combination of ``order`` joints that can fail."""
        return [list(c) for c in combinations([i for i in range(self.n) if self.fails[i]], order)]

    @staticmethod
    def goal(point: Sequence[float], orientation: Sequence[float] | None) -> Array:
        """Goal as position and rotation matrix, (12,); orientation as [qx, qy, qz, qw]."""
        x, y, z, w = [0.0, 0.0, 0.0, 1.0] if orientation is None else orientation
        rotation = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        return np.concatenate([np.asarray(point, float), np.ravel(rotation)])

    def frames(self, q: Array) -> tuple[Array, Array, Array, Array]:
        """Axes (N, n, 3), origins (N, n, 3), tool rotations (N, 3, 3) and positions (N, 3)."""
        count = len(q)
        rotation = np.broadcast_to(self.rotations[0], (count, 3, 3))
        position = np.broadcast_to(self.translations[0], (count, 3))
        axes, origins = np.empty((count, self.n, 3)), np.empty((count, self.n, 3))
        for i in range(self.n):
            axes[:, i] = rotation[:, :, 2]
            origins[:, i] = position
            if self.prismatic[i]:
                position = position + rotation[:, :, 2] * q[:, i, None]
            else:
                c, s = np.cos(q[:, i]), np.sin(q[:, i])
                turn = np.zeros((count, 3, 3))
                turn[:, 0, 0], turn[:, 0, 1] = c, -s
                turn[:, 1, 0], turn[:, 1, 1] = s, c
                turn[:, 2, 2] = 1.0
                rotation = rotation @ turn
            position = position + rotation @ self.translations[i + 1]
            rotation = rotation @ self.rotations[i + 1]
        return axes, origins, rotation, position

    def _normal(self) -> Array | None:
        """Normal of the plane of motion of a planar arm."""
        axes, _, _, _ = self.frames(np.zeros((1, self.n)))
        turning = axes[0][~self.prismatic]
        if not len(turning):
            return None
        normal = turning[0]
        flat = np.linalg.norm(np.cross(turning, normal), axis=1).max() < 1e-9
        slides = np.abs(axes[0][self.prismatic] @ normal)
        return normal if flat and not (slides > 1e-9).any() else None

    def _rows(self) -> Array:
        """Orthonormal rows of the residual that the arm can change."""
        identity = np.eye(6 if self.oriented else 3)
        if self.normal is None:
            return identity
        basis = np.linalg.svd(self.normal[None, :])[2]
        if not self.oriented:
            return basis[1:]
        rows = np.zeros((3, 6))
        rows[:2, :3], rows[2, 3:] = basis[1:], self.normal
        return rows

    def plane_distance(self, goal: Array) -> float:
        """Distance of a goal from what a planar arm can change: off its plane, or tilted (m)."""
        if self.normal is None:
            return 0.0
        _, _, rotation, position = self.frames(np.zeros((1, self.n)))
        height = float(self.normal @ (position[0] - goal[:3]))
        tilt = 0.0
        if self.oriented:
            relative = rotation[0] @ goal[3:].reshape(3, 3).T
            tilt = self.length * float(np.linalg.norm(relative @ self.normal - self.normal))
        return float(np.hypot(height, tilt))

    def residuals(self, q: Array, goal: Array) -> Array:
        """Residuals (N, m) of postures (N, n)."""
        _, _, rotation, position = self.frames(q)
        return self._residuals(rotation, position, goal)[0]

    def _residuals(self, rotation: Array, position: Array, goal: Array) -> tuple[Array, Array]:
        """Residuals (N, m) and vector parts (N, 3) of the error quaternions."""
        out = position - goal[:3]
        e = np.zeros_like(position)
        if self.oriented:
            e = _vector_part(rotation @ goal[3:].reshape(3, 3).T)
            out = np.concatenate([out, 2.0 * self.length * e], axis=1)
        return out @ self.rows.T, e

    def jacobians(self, q: Array, goal: Array) -> tuple[Array, Array]:
        """Residuals (N, m) and Jacobians (N, m, n)."""
        axes, origins, rotation, position = self.frames(q)
        residual, e = self._residuals(rotation, position, goal)
        return residual, self._jacobians(axes, self._linear(axes, origins, position), e)

    def _linear(self, axes: Array, origins: Array, position: Array) -> Array:
        """Linear velocities (N, n, 3) of the tool by each joint."""
        linear = _cross(axes, position[:, None] - origins)
        linear[:, self.prismatic] = axes[:, self.prismatic]
        return linear

    def _jacobians(self, axes: Array, linear: Array, e: Array) -> Array:
        full = linear
        if self.oriented:
            w = np.sqrt(np.maximum(1.0 - (e * e).sum(axis=1), 0.0))
            spin = self.length * (w[:, None, None] * axes + _cross(axes, e[:, None]))
            spin[:, self.prismatic] = 0.0
            full = np.concatenate([linear, spin], axis=2)
        return self.rows @ full.transpose(0, 2, 1)

    def derivatives(self, q: Array, goal: Array) -> Derivatives:
        """Residuals of postures (N, n) and their first and second derivatives.

        With i <= k, ``d2p / dq_i dq_k = z_i x dp / dq_k`` for a revolute joint i, else zero, and
        the error quaternion's is ``z_i z_k e / 4`` (a product of quaternions) for two hinges.
        """
        axes, origins, rotation, position = self.frames(q)
        residual, e = self._residuals(rotation, position, goal)
        linear = self._linear(axes, origins, position)
        full = _cross(axes[:, :, None], linear[:, None])
        if self.oriented:
            w = np.sqrt(np.maximum(1.0 - (e * e).sum(axis=1), 0.0))[:, None, None, None]
            e_ = e[:, None, None]
            both = _cross(axes[:, :, None], axes[:, None])
            dot = np.einsum('nia,nka->nik', axes, axes)[..., None]
            turn = 0.5 * self.length * (w * both - dot * e_ + _cross(both, e_))
            turn[:, :, self.prismatic] = 0.0
            full = np.concatenate([full, turn], axis=3)
        full[:, self.prismatic] = 0.0
        i, k = np.tril_indices(self.n, -1)
        full[:, i, k] = full[:, k, i]
        shape = (len(q), self.n, self.n, len(self.rows))
        hessian = np.moveaxis((full.reshape(-1, full.shape[3]) @ self.rows.T).reshape(shape), 3, 1)
        distance = np.linalg.norm(linear, axis=2)
        return Derivatives(residual, self._jacobians(axes, linear, e), hessian, distance)

    def third_bound(self, distance: Array, v: Array) -> Array:
        """Bound (N,) of the third derivative along any ``|dq_i| <= v_i``, all over that box.

        ``distance`` and ``v`` are (N, n). A position's derivative is at most the distance of the
        tool from the axis of the last joint that takes part, and that distance grows by at most
        what the later joints move; an error quaternion's of order 3 is at most 1/8.
        """
        third, moved = np.zeros(len(v)), np.zeros(len(v))
        total = after = v[:, ~self.prismatic].sum(axis=1)
        for k in range(self.n - 1, -1, -1):
            if self.prismatic[k]:
                third = third + 3.0 * v[:, k] * after**2
                moved = moved + v[:, k]
            else:
                before = after - v[:, k]
                reach = distance[:, k] + moved
                third = third + reach * (after**3 - before**3)
                moved = moved + reach * v[:, k]
                after = before
        return np.hypot(third, 0.25 * self.length * total**3)

    def second_bound(self, distance: Array, v: Array) -> Array:
        """The same of the second derivative."""
        second, moved = np.zeros(len(v)), np.zeros(len(v))
        total = after = v[:, ~self.prismatic].sum(axis=1)
        for k in range(self.n - 1, -1, -1):
            if self.prismatic[k]:
                second = second + 2.0 * v[:, k] * after
                moved = moved + v[:, k]
            else:
                before = after - v[:, k]
                reach = distance[:, k] + moved
                second = second + reach * (after**2 - before**2)
                moved = moved + reach * v[:, k]
                after = before
        return np.hypot(second, 0.5 * self.length * total**2)


def _cross(a: Array, b: Array) -> Array:
    """Cross products along the last axis; NumPy's own is slow on many small vectors."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def _vector_part(rotation: Array) -> Array:
    """Vector parts of the quaternions (scalar part >= 0) of rotations (N, 3, 3)."""
    axis = 0.5 * np.stack(
        [
            rotation[:, 2, 1] - rotation[:, 1, 2],
            rotation[:, 0, 2] - rotation[:, 2, 0],
            rotation[:, 1, 0] - rotation[:, 0, 1],
        ],
        axis=1,
    )  # sin(angle) * axis
    cosine = 0.5 * (np.trace(rotation, axis1=1, axis2=2) - 1.0)
    # vec(q) = sin(angle / 2) axis = sin(angle) axis / (2 cos(angle / 2))
    half: Array = axis / (2.0 * np.sqrt(np.maximum(0.5 * (1.0 + cosine), 1e-12)))[:, None]
    return half
