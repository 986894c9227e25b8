"""The arm as it was measured lately: the state that a plan starts from, and how old it is."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError

_SECOND = 1_000_000_000
# A driver may find another zero, but no joint stands further beyond its limits (rad or m).
_BEYOND = 2.0 * math.pi
_ABSURD_POSITION = 1e4  # rad or m, of joints that turn on and on
_ABSURD_SPEED = 100.0  # rad/s or m/s: no joint of an arm is as fast


class MeasuredStates:
    """The latest joint states of one arm, in order of their stamps (ns).

    Parameters
    ----------
    chain
        The full arm.
    velocity_window
        Where states carry no velocities, they are fitted to the positions of this long (s).
    """

    def __init__(self, chain: SerialChain, velocity_window: float) -> None:
        self._chain = chain
        self._window = velocity_window
        self._states: deque[tuple[int, Array, Array | None]] = deque(maxlen=500)

    def __bool__(self) -> bool:
        """Whether any state is known."""
        return bool(self._states)

    def clear(self) -> None:
        """Forget every state."""
        self._states.clear()

    @property
    def stamp(self) -> int:
        """Of the newest state (ns)."""
        return self._states[-1][0]

    @property
    def position(self) -> Array:
        """Newest measured joint positions, (n,), rad or m."""
        return self._states[-1][1]

    @property
    def velocity(self) -> Array:
        """Newest measured joint speeds, (n,), or those fitted to the latest positions.

        Zero for a joint that would be faster than any is.
        """
        stamp, _, v = self._states[-1]
        if v is not None:
            return v
        since = stamp - self._window * _SECOND
        recent = [(s, p) for s, p, _ in self._states if s >= since]
        if len(recent) < 2:
            return np.zeros(self._chain.n)
        t = np.array([s - stamp for s, _ in recent]) / _SECOND
        fitted = np.asarray(np.polyfit(t, np.array([p for _, p in recent]), 1)[0])
        return np.where(np.abs(fitted) <= _ABSURD_SPEED, fitted, 0.0)

    @property
    def period(self) -> float:
        """Time (s) between the two newest states; infinite before the second one."""
        if len(self._states) < 2:
            return math.inf
        return (self._states[-1][0] - self._states[-2][0]) / _SECOND

    def add(
        self, stamp: int, positions: Mapping[str, float], velocities: Mapping[str, float] | None
    ) -> bool:
        """Take in a state of the whole arm, by joint name; joints of others may be in it.

        Returns False for one that is late or repeated: newer ones have been used. Speeds are
        taken for unknown where one is not finite or faster than any joint.

        Raises
        ------
        InputError
            For a joint of the arm that is missing, NaN, or where no joint can stand.
        """
        q = self._of_arm(positions)
        self._refuse_absurd(q)
        if self._states and stamp <= self.stamp:
            return False
        v = None
        if velocities is not None and all(
            abs(velocities.get(name, math.nan)) <= _ABSURD_SPEED
            for name in self._chain.joint_names
        ):
            v = self._of_arm(velocities)
        self._states.append((stamp, q, v))
        return True

    def _of_arm(self, values: Mapping[str, float]) -> Array:
        """The arm's joints, (n,), out of values by name."""
        names = self._chain.joint_names
        missing = [name for name in names if name not in values]
        if missing:
            raise InputError(
                f'joint state: {", ".join(missing)}',
                f'missing; it names {", ".join(values) or "nothing"}',
            )
        q = np.array([values[name] for name in names], dtype=float)
        bad = [name for name in names if not math.isfinite(values[name])]
        if bad:
            raise InputError(f'joint state: {", ".join(bad)}', 'NaN or infinite')
        return q

    def _refuse_absurd(self, q: Array) -> None:
        lower = np.maximum(self._chain.lower - _BEYOND, -_ABSURD_POSITION)
        upper = np.minimum(self._chain.upper + _BEYOND, _ABSURD_POSITION)
        for name, value, low, high in zip(self._chain.joint_names, q, lower, upper, strict=True):
            if not low <= value <= high:
                raise InputError(
                    f'joint state: {name}',
                    f'is {value:g}; readings between {low:.6g} and {high:.6g} are believed',
                )
