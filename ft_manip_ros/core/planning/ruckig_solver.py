"""Time-optimal jerk-limited motion from Ruckig, also such as lasts longer than it allows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import ruckig

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.planning.limits import MotionLimits
from ft_manip_ros.core.planning.profiles import POSITION

# Ruckig refuses motions of several joints beyond 7600 s: they are solved in larger units (s).
_UNITS = (1.0, 1e3, 1e6, 1e9)


@dataclass(frozen=True, eq=False)
class Solution:
    """What Ruckig found.

    Attributes
    ----------
    profile : ndarray, shape (m, 5, P)
        As `profiles` has it, in a ``unit`` of time of so many s.
    duration
        Seconds.
    """

    profile: Array
    unit: float
    duration: float

    @property
    def end(self) -> Array:
        """Positions, (m,), where it has come to rest."""
        return self.profile[:, POSITION, -1].copy()


def _profile(found: ruckig.Trajectory) -> Array:
    """Phases of every joint, shape (m, 5, P): two of braking into the limits, seven, and rest.

    Ruckig knows phases after those too, for targets beyond the limits; at rest none is.
    """
    rows = []
    for profile in found.profiles[0]:
        brake = profile.brake
        rows.append(
            [
                *(*brake.t, *profile.t, np.inf),
                *(*brake.j, *profile.j, 0.0),
                *(*brake.p, *profile.p),
                *(*brake.v, *profile.v),
                *(*brake.a, *profile.a),
            ]
        )
    return np.array(rows).reshape(len(rows), 5, -1)


def _asked(
    q: Array, v: Array, limits: MotionLimits, target: Array | None, unit: float
) -> ruckig.InputParameter:
    """What is asked of Ruckig."""
    given = ruckig.InputParameter(len(q))
    given.current_position = q.tolist()
    given.current_velocity = (v * unit).tolist()
    given.max_velocity = (limits.velocity * unit).tolist()
    given.max_acceleration = (limits.acceleration * unit**2).tolist()
    given.max_jerk = (limits.jerk * unit**3).tolist()
    if target is None:
        given.control_interface = ruckig.ControlInterface.Velocity
        given.synchronization = ruckig.Synchronization.No
    else:
        given.target_position = target.tolist()
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
                return Solution(_profile(found), unit, float(found.duration * unit))
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
