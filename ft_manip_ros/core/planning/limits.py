"""What a motion may use: position ranges, speed, acceleration and jerk of the healthy joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import yaml
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, ChainArrays, SerialChain
from ft_manip_ros.core.joint import FULL_TURN

# A range this much beyond one turn is a real range with two ends, not a wrapping joint.
_BEYOND_A_TURN = 1e-3
# How far postures at rest stay off the limits, and what a reading may be wrong by (rad or m).
_CLEAR = 1e-3
_READING = 1e-3
# Share of the largest speed that noise may show of a joint at rest.
CREEP = 0.01
# Limits given with few digits still mean a full turn.
_SLACK = 1e-6


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits of n joints; positions of an unlimited joint may run on past a turn.

    Attributes
    ----------
    lower, upper : ndarray, shape (n,)
        Positions (rad or m).
    turns : ndarray of bool, shape (n,)
        Joints whose range holds a full turn: a posture is the same one a turn further.
    unlimited : ndarray of bool, shape (n,)
        Those of them that turn without end: their position bounds are not applied.
    velocity, acceleration, jerk : ndarray, shape (n,)
        Largest rates, per s, s^2 and s^3.
    """

    lower: Array
    upper: Array
    turns: NDArray[np.bool_]
    unlimited: NDArray[np.bool_]
    velocity: Array
    acceleration: Array
    jerk: Array

    def take(self, index: NDArray[np.intp]) -> MotionLimits:
        """Limits of the joints at ``index``."""
        return MotionLimits(
            self.lower[index],
            self.upper[index],
            self.turns[index],
            self.unlimited[index],
            self.velocity[index],
            self.acceleration[index],
            self.jerk[index],
        )

    def scaled(self, factor: float) -> MotionLimits:
        """The same position ranges with speed, acceleration and jerk times ``factor``."""
        return replace(
            self,
            velocity=self.velocity * factor,
            acceleration=self.acceleration * factor,
            jerk=self.jerk * factor,
        )


def motion_limits(chain: SerialChain, *, operating: bool, jerk_time: float) -> MotionLimits:
    """Limits of all joints of an arm.

    Parameters
    ----------
    operating
        True before a failure: the operating limits bound where a joint can freeze, so they are
        obeyed. False after one: the physical limits hold.
    jerk_time
        Time (s) to build up full acceleration; arm files give no jerk limit.
    """
    lower = chain.operating_lower if operating else chain.lower
    upper = chain.operating_upper if operating else chain.upper
    turns = chain.arrays.wraps & (upper - lower > FULL_TURN - _SLACK)
    return MotionLimits(
        lower,
        upper,
        turns,
        turns & (upper - lower < FULL_TURN + _BEYOND_A_TURN),
        chain.velocity,
        chain.acceleration,
        chain.acceleration / jerk_time,
    )


def arrays_within(chain: SerialChain, limits: MotionLimits, *, clear: bool = False) -> ChainArrays:
    """Return the arm as kernels read it, with the limits to obey.

    With ``clear``, ranges are a little narrower: a joint at rest on its very limit would be
    measured beyond it half of the time.
    """
    room = np.minimum(_CLEAR, 0.01 * (limits.upper - limits.lower)) * clear
    return chain.arrays._replace(
        lower=limits.lower + room, upper=limits.upper - room, wraps=limits.turns
    )


def within_noise(q: Array, v: Array, limits: MotionLimits) -> tuple[Array, Array]:
    """Return a measured state, (n,) each, without what only noise does to it at a limit.

    A joint that rests on its limit is read a hair beyond it, or creeping outward: it counts as
    standing on it. One that stands farther outside, or moves, is left as it is.
    """
    inside = np.clip(q, limits.lower, limits.upper)
    q = np.where(~limits.unlimited & (np.abs(q - inside) <= _READING), inside, q)
    out = ((q - limits.lower <= _READING) & (v < 0.0)) | (
        (limits.upper - q <= _READING) & (v > 0.0)
    )
    creeping = np.abs(v) <= CREEP * limits.velocity
    return q, np.where(~limits.unlimited & out & creeping, 0.0, v)


def joint_limits_yaml(chain: SerialChain, frozen: Mapping[str, float]) -> str:
    """Return the physical limits as a ``joint_limits.yaml`` for MoveIt; frozen joints have none.

    A frozen joint's range is the one position where it stands.
    """
    limits = {}
    for joint, wraps in zip(chain.joints, chain.arrays.wraps, strict=True):
        stuck = joint.name in frozen
        at = float(frozen.get(joint.name, 0.0))
        limits[joint.name] = {
            'has_position_limits': stuck or not bool(wraps),
            'min_position': at if stuck else joint.lower,
            'max_position': at if stuck else joint.upper,
            'has_velocity_limits': True,
            'max_velocity': 0.0 if stuck else joint.velocity,
            'has_acceleration_limits': True,
            'max_acceleration': 0.0 if stuck else joint.acceleration,
        }
    return yaml.safe_dump({'joint_limits': limits}, sort_keys=False)


def travel(start: Array, end: Array, unlimited: NDArray[np.bool_]) -> Array:
    """Signed way from ``start`` to ``end``, (..., n): the short way round where ``unlimited``."""
    way = end - start
    if not unlimited.any():
        return np.asarray(way)
    turns = np.round(way / FULL_TURN) * FULL_TURN
    return np.where(unlimited, way - turns, way)


def folded(postures: Array, near: Array, limits: MotionLimits) -> Array:
    """The same postures, (K, m), in the turn nearest to ``near``, (m,), that limits allow."""
    turning = limits.turns
    moved = near + travel(near, postures, turning)
    over = turning & ~limits.unlimited & (moved > limits.upper)
    under = turning & ~limits.unlimited & (moved < limits.lower)
    # Kernels are compiled for whole rows.
    return np.ascontiguousarray(moved - FULL_TURN * over + FULL_TURN * under)
