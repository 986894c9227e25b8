"""Time-optimal jerk-limited motion from Ruckig, also such as lasts longer than it allows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
import ruckig

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.planning.limits import MotionLimits

# Ruckig refuses motions of several joints beyond 7600 s: they are solved in larger units (s).
_UNITS = (1.0, 1e3, 1e6, 1e9)


@dataclass(frozen=True)
class Solution:
    """What Ruckig found, in a ``unit`` of time of so many s."""

    found: ruckig.Trajectory
    unit: float

    @property
    def duration(self) -> float:
        """Seconds."""
        return float(self.found.duration * self.unit)

    @property
    def end(self) -> Array:
        """Positions, (m,), where it has come to rest."""
        return np.array(self.found.at_time(self.found.duration + 1.0)[0])

    def switches(self) -> list[float]:
        """Times (s) at which a joint's jerk changes."""
        ends: list[float] = []
        for profile in self.found.profiles[0]:
            ends += accumulate([*profile.brake.t, *profile.t, *profile.accel.t])
        return [time * self.unit for time in ends]

    def turns(self) -> list[list[float]]:
        """For each joint the times (s) at which its speed passes zero."""
        return [
            [time * self.unit for time in _turning_times(profile)]
            for profile in self.found.profiles[0]
        ]

    def at(self, time: float) -> tuple[list[float], list[float], list[float]]:
        """Positions, speeds and accelerations at a time (s)."""
        q, v, a = self.found.at_time(time / self.unit)[:3]
        if self.unit != 1.0:
            v, a = [x / self.unit for x in v], [x / self.unit**2 for x in a]
        return q, v, a


def _asked(
    q: Array, v: Array, limits: MotionLimits, target: Array | None, unit: float
) -> ruckig.InputParameter:
    """What is asked of Ruckig."""
    given = ruckig.InputParameter(len(q))
    given.current_position = list(q)
    given.current_velocity = list(v * unit)
    given.max_velocity = list(limits.velocity * unit)
    given.max_acceleration = list(limits.acceleration * unit**2)
    given.max_jerk = list(limits.jerk * unit**3)
    if target is None:
        given.control_interface = ruckig.ControlInterface.Velocity
        given.synchronization = ruckig.Synchronization.No
    else:
        given.target_position = list(target)
    return given


def calculate(
    q: Array, v: Array, limits: MotionLimits, target: Array | None = None
) -> Solution | None:
    """Fastest motion to a target, or to rest wherever that is; None where Ruckig finds none.

    Parameters
    ----------
    q, v, target : shape (m,)
        All joints arrive at the target together; each comes to rest by itself without one.
    limits
        Of speed, acceleration and jerk.
    """
    for unit in _UNITS:
        found = ruckig.Trajectory(len(q))
        try:
            given = _asked(q, v, limits, target, unit)
            if ruckig.Ruckig(len(q)).calculate(given, found) == ruckig.Result.Working:
                return Solution(found, unit)
        except (ruckig.RuckigError, ValueError):
            # Its Python module has no name for the result that a motion takes too long.
            continue
    return None


def solve(q: Array, v: Array, limits: MotionLimits, target: Array | None = None) -> Solution:
    """As `calculate`; raises `ArithmeticError` where there is no motion."""
    found = calculate(q, v, limits, target)
    if found is None:
        raise ArithmeticError(f'Ruckig found no motion from {q} at {v} to {target} in {limits}')
    return found


def _turning_times(profile: ruckig.Profile) -> list[float]:
    """Times (s) at which a joint's speed passes zero.

    Ruckig's own ``position_extrema`` overlooks those in phases of constant acceleration.
    """
    times = []
    begin = 0.0
    for part in (profile.brake, profile, profile.accel):
        lengths = part.t
        if not any(lengths):
            continue
        for j, length, v, a in zip(part.j, lengths, part.v, part.a, strict=False):
            if length == 0.0:
                continue
            v_end, a_end = v + (a + 0.5 * j * length) * length, a + j * length
            if v * v_end > 0.0 and a * a_end >= 0.0:
                begin += length
                continue
            for root in _roots(0.5 * j, a, v):
                if 0.0 < root < length:
                    times.append(begin + root)
            begin += length
    return times


def _roots(c2: float, c1: float, c0: float) -> tuple[float, ...]:
    """Real roots of c2 t^2 + c1 t + c0."""
    if c2 == 0.0:
        return () if c1 == 0.0 else (-c0 / c1,)
    inside = c1 * c1 - 4.0 * c2 * c0
    if inside < 0.0:
        return ()
    # The larger one first, free of cancellation.
    q = -0.5 * (c1 + math.copysign(math.sqrt(inside), c1))
    return (0.0, 0.0) if q == 0.0 else (q / c2, c0 / q)
