"""The serial chain: the one kinematic type behind DH tables, URDFs and their RODs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.joint import Axis, Joint
from ft_manip_ros.core.screw_form import screw_form

Array = NDArray[np.float64]


class ChainArrays(NamedTuple):
    """What the compiled kernels read: plain contiguous arrays, no Python objects.

    The tool frame is ``P_0 M_0(s_0) P_1 M_1(s_1) ... M_{N-1}(s_{N-1}) P_N`` with constant
    placements ``P`` and motions ``M`` about (revolute) or along (prismatic) the local z axis.
    Each of the n joints has one axis, ``s = q``, unless others follow it: ``s_i = ratio_i
    q[driver_i]``.
    """

    rotations: NDArray[np.float64]  # (N+1, 3, 3), of the placements
    translations: NDArray[np.float64]  # (N+1, 3), m
    prismatic: NDArray[np.bool_]  # (N,)
    lower: NDArray[np.float64]  # (n,), physical limits, rad or m
    upper: NDArray[np.float64]  # (n,)
    wraps: NDArray[np.bool_]  # (n,), a full turn: no limit to run into
    screws: NDArray[np.float64]  # (N, 6), the placements as `screw_form` rewrites them
    driver: NDArray[np.int64]  # (N,), joint that moves each axis; empty: its own, at ratio 1
    ratio: NDArray[np.float64]  # (N,), motion of the axis per motion of that joint; or empty


@dataclass(frozen=True, eq=False)
class SerialChain:
    """A serial chain of constant placements, each followed by one moving axis, its local z.

    Attributes
    ----------
    name
        Name of the arm.
    joints
        The n joints, base to tip.
    rotations : ndarray, shape (N+1, 3, 3)
        Constant rotation from the moved frame of axis i-1 (the base for i = 0) to axis i;
        the last one leads to the tool.
    translations : ndarray, shape (N+1, 3)
        The same placements' translations (m).
    frozen
        For a ROD: positions (rad or m) of the joints of the parent arm that are frozen and are
        now part of the placements.
    driven
        The N axes, where some follow the joint of another one (mimic joints); empty where each
        joint has the one axis of its own, N = n.
    """

    name: str
    joints: tuple[Joint, ...]
    rotations: Array
    translations: Array
    frozen: Mapping[str, float] = field(default_factory=dict)
    driven: tuple[Axis, ...] = ()

    def __post_init__(self) -> None:
        n = len(self.axes)
        rotations = np.ascontiguousarray(self.rotations, dtype=float)
        translations = np.ascontiguousarray(self.translations, dtype=float)
        if rotations.shape != (n + 1, 3, 3) or translations.shape != (n + 1, 3):
            raise InputError(
                f'chain {self.name!r}: placements',
                f'have shapes {rotations.shape} and {translations.shape}; '
                f'{n} axes need {(n + 1, 3, 3)} and {(n + 1, 3)}',
            )
        if {axis.joint for axis in self.axes} != set(range(self.n)):
            raise InputError(f'chain {self.name!r}: driven', 'does not name each joint')
        if not (np.isfinite(rotations).all() and np.isfinite(translations).all()):
            raise InputError(f'chain {self.name!r}: placements', 'contain NaN or infinity')
        names = [joint.name for joint in self.joints]
        if len(set(names)) != self.n:
            twice = sorted({name for name in names if names.count(name) > 1})
            raise InputError(f'chain {self.name!r}: joint names', f'{twice} appear more than once')
        rotations.setflags(write=False)
        translations.setflags(write=False)
        object.__setattr__(self, 'rotations', rotations)
        object.__setattr__(self, 'translations', translations)

    @property
    def n(self) -> int:
        """Number of joints that move."""
        return len(self.joints)

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """The N moving axes, base to tip: one a joint unless `driven` says otherwise."""
        own = (Axis(j.name, i, prismatic=j.prismatic) for i, j in enumerate(self.joints))
        return self.driven or tuple(own)

    def axis_positions(self, q: Array) -> Array:
        """Positions of the axes, shape (..., N), at joint positions ``q``, shape (..., n)."""
        if not self.driven:
            return q
        return q[..., self.arrays.driver] * self.arrays.ratio

    @cached_property
    def uncoupled(self) -> SerialChain:
        """The same arm with every axis a joint of its own, over the range that it can have here.

        It reaches whatever this arm reaches: what it is proved to miss, this arm misses too.
        """
        if not self.driven:
            return self
        joints = []
        for axis in self.driven:
            leader = self.joints[axis.joint]
            lower, upper = sorted((axis.ratio * leader.lower, axis.ratio * leader.upper))
            speed = abs(axis.ratio)
            joints.append(
                Joint(
                    axis.name,
                    lower,
                    upper,
                    velocity=speed * leader.velocity,
                    acceleration=speed * leader.acceleration,
                    prismatic=axis.prismatic,
                )
            )
        return replace(self, joints=tuple(joints), driven=())

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the moving joints, base to tip."""
        return tuple(joint.name for joint in self.joints)

    @cached_property
    def lower(self) -> Array:
        """Physical lower limits, shape (n,), rad or m."""
        return np.array([joint.lower for joint in self.joints], dtype=float)

    @cached_property
    def upper(self) -> Array:
        """Physical upper limits, shape (n,), rad or m."""
        return np.array([joint.upper for joint in self.joints], dtype=float)

    @cached_property
    def operating_lower(self) -> Array:
        """Operating lower limits, shape (n,), rad or m."""
        return np.array([joint.operating[0] for joint in self.joints], dtype=float)

    @cached_property
    def operating_upper(self) -> Array:
        """Operating upper limits, shape (n,), rad or m."""
        return np.array([joint.operating[1] for joint in self.joints], dtype=float)

    @cached_property
    def velocity(self) -> Array:
        """Largest joint speeds, shape (n,), rad/s or m/s."""
        return np.array([joint.velocity for joint in self.joints], dtype=float)

    @cached_property
    def acceleration(self) -> Array:
        """Largest joint accelerations, shape (n,), rad/s^2 or m/s^2."""
        return np.array([joint.acceleration for joint in self.joints], dtype=float)

    @cached_property
    def arrays(self) -> ChainArrays:
        """The chain as the compiled kernels read it."""
        return ChainArrays(
            self.rotations,
            self.translations,
            np.array([axis.prismatic for axis in self.axes], dtype=np.bool_),
            self.lower,
            self.upper,
            np.array([self._wraps(i) for i in range(self.n)], dtype=np.bool_),
            screw_form(self.rotations, self.translations),
            np.array([axis.joint for axis in self.driven], dtype=np.int64),
            np.array([axis.ratio for axis in self.driven], dtype=float),
        )

    def _wraps(self, i: int) -> bool:
        """Whether after a full turn of joint i all its axes are back where they were."""
        mine = [axis for axis in self.axes if axis.joint == i]
        whole = all(not axis.prismatic and axis.ratio == round(axis.ratio) for axis in mine)
        return self.joints[i].wraps and whole

    def index(self, name: str) -> int:
        """Place of a joint by name.

        Raises
        ------
        InputError
            If the chain has no such joint; the message lists those it has.
        """
        try:
            return self.joint_names.index(name)
        except ValueError:
            raise InputError(
                f'joint {name!r}',
                f'is not a joint of {self.name!r}; it has {", ".join(self.joint_names)}',
            ) from None

    def vector(self, values: Mapping[str, float]) -> Array:
        """Joint vector, shape (n,), from values by name (each joint exactly once)."""
        q = np.full(self.n, np.nan)
        for name, value in values.items():
            q[self.index(name)] = value
        missing = [name for name, value in zip(self.joint_names, q, strict=True) if value != value]
        if missing:
            raise InputError(f'joints {missing}', 'have no value or NaN')
        return q

    def check_vector(self, q: Sequence[float] | Array, field_name: str = 'q') -> Array:
        """Return ``q`` as a finite float array of shape (n,), or raise `InputError`."""
        out = np.ascontiguousarray(q, dtype=float)
        if out.shape != (self.n,):
            raise InputError(field_name, f'has shape {out.shape}; {self.name!r} needs ({self.n},)')
        if not np.isfinite(out).all():
            raise InputError(field_name, 'contains NaN or infinity')
        return out

    def freeze(self, angles: Mapping[str, float]) -> SerialChain:
        """Return the ROD with the named joints frozen at the given positions (rad or m).

        A frozen joint may stand outside its limits: a lock happens where it happens. What
        mimics it is frozen with it.

        Raises
        ------
        InputError
            For an unknown joint or a position that is not finite.
        """
        at = {self.index(name): float(value) for name, value in angles.items()}
        for i, value in at.items():
            if not np.isfinite(value):
                raise InputError(f'frozen {self.joint_names[i]!r}', f'is {value}; must be finite')
        rotations = [self.rotations[0]]
        translations = [self.translations[0]]
        kept = [i for i in range(self.n) if i not in at]
        driven: list[Axis] = []
        for k, axis in enumerate(self.axes):
            r_next, t_next = self.rotations[k + 1], self.translations[k + 1]
            if axis.joint not in at:
                driven.append(replace(axis, joint=kept.index(axis.joint)))
                rotations.append(r_next)
                translations.append(t_next)
                continue
            r_motion, t_motion = joint_motion(axis.prismatic, axis.ratio * at[axis.joint])
            r, t = rotations[-1], translations[-1]
            translations[-1] = t + r @ (t_motion + r_motion @ t_next)
            rotations[-1] = r @ r_motion @ r_next
        alone = all(axis.name == self.joint_names[kept[axis.joint]] for axis in driven)
        return replace(
            self,
            joints=tuple(self.joints[i] for i in kept),
            rotations=np.array(rotations),
            translations=np.array(translations),
            frozen={**self.frozen, **{self.joint_names[i]: v for i, v in at.items()}},
            driven=() if alone else tuple(driven),
        )


def joint_motion(prismatic: bool, position: float) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,) of one joint about or along its local z axis."""
    if prismatic:
        return np.eye(3), np.array([0.0, 0.0, position])
    c, s = np.cos(position), np.sin(position)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3)
