"""Standard (distal) Denavit-Hartenberg tables, as the paper prints them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.joint import Joint


@dataclass(frozen=True, eq=False)
class DhTable:
    """An arm as rows of T_i = Rz(theta_i + offset_i) Tz(d_i) Tx(a_i) Rx(alpha_i).

    Attributes
    ----------
    name
        Name of the arm.
    joints
        Names, kinds and limits, base to tip.
    d, a, alpha, offset : ndarray, shape (n,)
        m, m, rad, rad. For a prismatic joint, the joint variable adds to d and ``offset`` is
        its constant theta.
    """

    name: str
    joints: tuple[Joint, ...]
    d: Array
    a: Array
    alpha: Array
    offset: Array

    def __post_init__(self) -> None:
        n = len(self.joints)
        if n == 0:
            raise InputError(f'DH table {self.name!r}', 'has no joints; at least one is needed')
        for key in ('d', 'a', 'alpha', 'offset'):
            column = np.ascontiguousarray(getattr(self, key), dtype=float)
            if column.shape != (n,):
                raise InputError(
                    f'DH table {self.name!r}: {key}', f'has shape {column.shape}; needs ({n},)'
                )
            if not np.isfinite(column).all():
                raise InputError(f'DH table {self.name!r}: {key}', 'contains NaN or infinity')
            column.setflags(write=False)
            object.__setattr__(self, key, column)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    def chain(self) -> SerialChain:
        """Return the table as a serial chain (base placement: identity)."""
        n = self.n
        rotations = np.empty((n + 1, 3, 3))
        translations = np.empty((n + 1, 3))
        # Rz(offset) comes before the motion about the same axis, hence in the placement before it.
        rotations[0] = _rotation_z(self.offset[0])
        translations[0] = 0.0
        for i in range(n):
            following = _rotation_z(self.offset[i + 1]) if i + 1 < n else np.eye(3)
            rotations[i + 1] = _rotation_x(self.alpha[i]) @ following
            translations[i + 1] = (self.a[i], 0.0, self.d[i])
        return SerialChain(self.name, self.joints, rotations, translations)

    def scaled(self, factor: float) -> DhTable:
        """Return the same arm with every length times ``factor`` (> 0)."""
        if not (np.isfinite(factor) and factor > 0.0):
            raise InputError('scale', f'is {factor}; must be a finite number > 0')
        return replace(self, d=self.d * factor, a=self.a * factor)


def _rotation_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _rotation_x(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
