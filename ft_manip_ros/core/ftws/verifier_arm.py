"""The verifier's own kinematics: batched NumPy, written from the chain's definition alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Closer to a limit than this (rad or m), a joint is asked to contribute less.
_LIMIT_ZONE = 0.4


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
        full = self._full_residuals(np.zeros((1, self.n)), goal)[0]
        height = float(self.normal @ full[:3])
        tilt = 0.0
        if self.oriented:
            relative = self.frames(np.zeros((1, self.n)))[2][0] @ goal[3:].reshape(3, 3).T
            tilt = self.length * float(np.linalg.norm(relative @ self.normal - self.normal))
        return float(np.hypot(height, tilt))

    def _full_residuals(self, q: Array, goal: Array) -> Array:
        _, _, rotation, position = self.frames(q)
        out = position - goal[:3]
        if not self.oriented:
            return out
        e = _twice_vector_part(rotation @ goal[3:].reshape(3, 3).T)
        return np.concatenate([out, self.length * e], axis=1)

    def residuals(self, q: Array, goal: Array) -> Array:
        """Residuals (N, m) of postures (N, n)."""
        return self._full_residuals(q, goal) @ self.rows.T

    def jacobians(self, q: Array, goal: Array) -> tuple[Array, Array, Array, Array]:
        """Jacobians (N, m, n), distances (N, n), axes and linear velocities (N, n, 3)."""
        axes, origins, rotation, position = self.frames(q)
        linear = np.cross(axes, position[:, None] - origins)
        linear[:, self.prismatic] = axes[:, self.prismatic]
        full = linear
        if self.oriented:
            e = 0.5 * _twice_vector_part(rotation @ goal[3:].reshape(3, 3).T)
            w = np.sqrt(np.maximum(1.0 - (e * e).sum(axis=1), 0.0))
            spin = self.length * (w[:, None, None] * axes + np.cross(axes, e[:, None]))
            spin[:, self.prismatic] = 0.0
            full = np.concatenate([linear, spin], axis=2)
        jacobian = np.einsum('ra,nia->nri', self.rows, full)
        return jacobian, np.linalg.norm(linear, axis=2), axes, linear

    def hessians(self, axes: Array, linear: Array) -> Array:
        """Second derivatives (N, m, n, n) of the position rows, from what `jacobians` returns."""
        # With i <= k, d2p / dq_i dq_k = z_i x dp / dq_k for a revolute joint i, else zero.
        turned = np.cross(axes[:, :, None], linear[:, None])
        turned[:, self.prismatic] = 0.0
        upper = turned * np.triu(np.ones((self.n, self.n)))[:, :, None]
        strict = turned * np.triu(np.ones((self.n, self.n)), 1)[:, :, None]
        return np.einsum('ra,nika->nrik', self.rows[:, :3], upper + strict.transpose(0, 2, 1, 3))

    def local(self, q: Array, goal: Array) -> tuple[Array, Array, Array]:
        """Residual (m,), Jacobian (m, n) and distances (n,) at one posture."""
        jacobian, distance, _, _ = self.jacobians(q[None], goal)
        return self.residuals(q[None], goal)[0], jacobian[0], distance[0]

    def inverse(self, jacobian: Array, q: Array, free: list[int]) -> Array:
        """Right inverses (N, f, m) that ask less of joints near their limits."""
        lower, upper = self.lower[free], self.upper[free]
        zone = np.minimum(_LIMIT_ZONE, 0.5 * (upper - lower))
        share = np.clip(np.minimum(q - lower, upper - q) / np.maximum(zone, 1e-12), 1e-2, 1.0)
        weights = np.where(self.wraps[free], 1.0, share)
        inverse: Array = weights[:, :, None] * np.linalg.pinv(
            jacobian * weights[:, None, :], rcond=1e-7
        )
        return inverse

    def correct(self, q: Array, free: list[int], goal: Array, steps: int = 6) -> Array:
        """Newton's method on the free joints of postures (N, n)."""
        q = q.copy()
        for _ in range(steps):
            residual = self.residuals(q, goal)
            if np.linalg.norm(residual, axis=1).max() < 1e-12:
                break
            inverse = self.inverse(self.jacobians(q, goal)[0][:, :, free], q[:, free], free)
            step = np.einsum('nir,nr->ni', inverse, residual)
            largest = np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-300)
            q[:, free] -= step * np.minimum(1.0, 0.3 / largest)
        return q

    def descend(self, q: Array, free: list[int], goal: Array) -> Array:
        """Damped Gauss-Newton within the limits, towards a local minimum of the residual."""
        q = q.copy()
        damping = 1e-2
        norm = float(np.linalg.norm(self.residuals(q[None], goal)))
        for _ in range(60):
            residual, jacobian, _ = self.local(q, goal)
            part = jacobian[:, free]
            normal = part.T @ part + damping * np.eye(len(free))
            trial = q.copy()
            trial[free] -= np.linalg.solve(normal, part.T @ residual)
            trial = np.where(self.wraps, trial, np.clip(trial, self.lower, self.upper))
            after = float(np.linalg.norm(self.residuals(trial[None], goal)))
            damping = max(damping * 0.3, 1e-9) if after < norm else damping * 4.0
            if after < norm:
                q, norm = trial, after
        return q

    def derivative_bounds(self, distance: Array, v: Array) -> tuple[Array, Array]:
        """Bounds of the second and third derivatives along |dq_i| <= v_i, in that box.

        ``distance`` and ``v`` are (..., n); the results (...,). The third is the position's.
        """
        second = np.zeros(v.shape[:-1])
        third, moved = second.copy(), second.copy()
        total = after = v[..., ~self.prismatic].sum(axis=-1)
        for k in range(self.n - 1, -1, -1):
            if self.prismatic[k]:
                second = second + 2.0 * v[..., k] * after
                third = third + 3.0 * v[..., k] * after**2
                moved = moved + v[..., k]
            else:
                before = after - v[..., k]
                reach = distance[..., k] + moved
                second = second + reach * (after**2 - before**2)
                third = third + reach * (after**3 - before**3)
                moved = moved + reach * v[..., k]
                after = before
        return np.hypot(second, 0.5 * self.length * total**2), third

    def remainder(self, distance: Array, v: Array, bend: Array) -> Array:
        """Bound (N,) of the residual's change beyond first order along |dq_i| <= v_i.

        ``bend`` (N,) bounds the second derivative of the position at the box's centre.
        """
        second, third = self.derivative_bounds(distance, v)
        total = v[..., ~self.prismatic].sum(axis=-1)
        exact: Array = 0.5 * bend + third / 6.0 + 0.25 * self.length * total**2
        return np.minimum(exact, 0.5 * second)

    def lower_bounds(
        self, q: Array, half: Array, residuals: Array, goal: Array, aim: Array | None
    ) -> tuple[Array, Array]:
        """Lower bounds (N,) of the residual over boxes, and each joint's cost (N, n)."""
        jacobian, distance, axes, linear = self.jacobians(q, goal)
        norms = np.linalg.norm(residuals, axis=1)
        remainder, third = self.derivative_bounds(distance, half)
        best = np.full(len(q), -np.inf)
        cost = half * np.maximum(distance, 1e-6)
        directions = [residuals / np.maximum(norms, 1e-300)[:, None]]
        if aim is not None:
            directions.append(np.broadcast_to(aim, residuals.shape))
        for u in directions:
            value = (u * residuals).sum(axis=1)
            slope = np.abs(np.einsum('nr,nri->ni', u, jacobian)) * half
            bound = value - slope.sum(axis=1) - 0.5 * remainder
            if not self.oriented:
                world = u @ self.rows
                turned = np.cross(world[:, None], axes)
                turned[:, self.prismatic] = 0.0
                curve = np.einsum('nia,nka->nik', turned, linear)
                sized = half[:, :, None] * half[:, None, :]
                off = (np.abs(curve) * sized * np.triu(np.ones((self.n, self.n)), 1)).sum((1, 2))
                own = np.einsum('nii->ni', curve) * half**2
                own[:, self.prismatic] = 0.0
                # |u.F| is convex where the curvature is positive: the slope is then paid twice.
                quadratic = -slope + 0.5 * own
                turning = (own > 0.0) & (slope < own)
                quadratic[turning] = -0.5 * slope[turning] ** 2 / own[turning]
                bound = np.maximum(bound, value + quadratic.sum(axis=1) - off - third / 6.0)
            best = np.maximum(best, bound)
        return best * (1.0 - 1e-9) - 1e-11, cost


def _twice_vector_part(rotation: Array) -> Array:
    """2 vec(q) of rotations (N, 3, 3), with the quaternion's scalar part >= 0, by half angles."""
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
    half = np.sqrt(np.maximum(0.5 * (1.0 + cosine), 1e-12))
    return axis / half[:, None]
