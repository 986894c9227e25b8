"""Jerk-limited joint motion by Ruckig: stop, move from the moving state, move between rests."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
import ruckig

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.planning.limits import MotionLimits, travel

# Time stamps of ROS messages are whole nanoseconds; states are sampled at exactly those times.
TICK = 1e-9
# Phase switches closer together than this become one point.
SHORTEST_STEP = 2e-5
# Moves shorter than this (rad or m) are no moves.
_SMALLEST_WAY = 1e-9
# Slower than this (rad/s or m/s) is at rest.
_AT_REST = 1e-9


@dataclass(frozen=True, eq=False)
class Motion:
    """Joint states at increasing times from 0; rest or not at the start, rest at the end.

    Every switch of jerk is among the samples, so the motion between two of them is a cubic and
    a controller's cubic or quintic spline through the samples reproduces it.

    Attributes
    ----------
    times : ndarray, shape (T,)
    positions, velocities, accelerations : ndarray, shape (T, m)
    """

    times: Array
    positions: Array
    velocities: Array
    accelerations: Array

    @property
    def duration(self) -> float:
        """Seconds to the last sample."""
        return float(self.times[-1])


def stop(q: Array, v: Array, limits: MotionLimits, period: float) -> Motion:
    """Bring every joint to rest by itself as fast as the limits allow.

    Parameters
    ----------
    q, v : shape (m,)
        Measured state; a speed beyond the limit is brought down with the rest.
    period
        Longest time between samples (s).
    """
    given = ruckig.InputParameter(len(q))
    given.control_interface = ruckig.ControlInterface.Velocity
    given.synchronization = ruckig.Synchronization.No
    _fill(given, q, v, limits)
    return _solved(given, period)


def stopping_range(q: Array, v: Array, limits: MotionLimits) -> tuple[Array, Array]:
    """Lowest and highest position, each (m,), that the start state makes unavoidable."""
    end = stop(q, v, limits, 1.0).positions[-1]
    return np.minimum(q, end), np.maximum(q, end)


def move_from(
    q: Array,
    v: Array,
    target: Array,
    limits: MotionLimits,
    braking: MotionLimits,
    period: float,
) -> Motion:
    """Move from a moving state to rest at ``target``, (m,), all joints arriving together.

    Joints first flow on or brake within ``limits``. Where the fastest such motion would leave a
    joint's range, all joints stop first, as hard as ``braking`` allows, and then move straight.
    """
    way = travel(q, target, limits.unlimited)
    if not np.any(np.abs(v) > _AT_REST):
        return move_between(q, q + way, limits, period)
    direct = _direct(q, v, q + way, limits, braking)
    if direct is not None:
        return _sampled(direct, len(q), period)
    halt = stop(q, v, braking, period)
    rest = halt.positions[-1]
    go = move_between(rest, rest + travel(rest, target, limits.unlimited), limits, period)
    return joined([halt, go])


def arrival_time(
    q: Array, v: Array, target: Array, limits: MotionLimits, braking: MotionLimits
) -> float:
    """Duration (s) of `move_from`, without its samples."""
    way = travel(q, target, limits.unlimited)
    if np.any(np.abs(v) > _AT_REST):
        direct = _direct(q, v, q + way, limits, braking)
        if direct is not None:
            return float(direct.duration)
    return move_from(q, v, target, limits, braking, 10.0).duration


def _direct(
    q: Array, v: Array, target: Array, limits: MotionLimits, braking: MotionLimits
) -> ruckig.Trajectory | None:
    """Fastest motion from the moving state to the target; None where it would leave a range."""
    given = ruckig.InputParameter(len(q))
    _fill(given, q, v, limits)
    given.target_position = list(target)
    found = ruckig.Trajectory(len(q))
    if ruckig.Ruckig(len(q)).calculate(given, found) != ruckig.Result.Working:
        return None
    low, high = stopping_range(q, v, braking)
    low = np.minimum(low, limits.lower) - _SMALLEST_WAY
    high = np.maximum(high, limits.upper) + _SMALLEST_WAY
    for i, profile in enumerate(found.profiles[0]):
        if limits.unlimited[i]:
            continue
        turns = [found.at_time(time)[0][i] for time in _turning_times(profile)]
        if any(not low[i] <= position <= high[i] for position in turns):
            return None
    return found


def move_between(q: Array, target: Array, limits: MotionLimits, period: float) -> Motion:
    """Move straight in joint space from rest to rest; a box of limits holds both ends, so all."""
    way = target - q
    longest = float(np.max(np.abs(way), initial=0.0))
    if longest < _SMALLEST_WAY:
        zero = np.zeros((1, len(q)))
        return Motion(np.zeros(1), q[None, :].copy(), zero, zero)
    given = ruckig.InputParameter(1)
    moving = np.abs(way) > _SMALLEST_WAY * longest
    part = np.abs(way[moving])
    given.current_position, given.target_position = [0.0], [1.0]
    given.max_velocity = [float(np.min(limits.velocity[moving] / part))]
    given.max_acceleration = [float(np.min(limits.acceleration[moving] / part))]
    given.max_jerk = [float(np.min(limits.jerk[moving] / part))]
    line = _solved(given, period)
    return Motion(
        line.times,
        q + line.positions * way,
        line.velocities * way,
        line.accelerations * way,
    )


def hold(q: Array, duration: float) -> Motion:
    """Stand still at ``q``, (m,)."""
    zero = np.zeros((2, len(q)))
    end = np.ceil(duration / TICK) * TICK
    return Motion(np.array([0.0, end]), np.array([q, q]), zero, zero)


def joined(parts: list[Motion]) -> Motion:
    """Run motions one after the other; each starts in the state in which the last one ended."""
    times, chosen, offset = [], [], 0.0
    for k, part in enumerate(parts):
        rows = slice(0, None) if k == 0 else slice(1, None)
        times.append(offset + part.times[rows])
        chosen.append((part, rows))
        offset += part.duration
    return Motion(
        np.round(np.concatenate(times) / TICK) * TICK,
        np.concatenate([part.positions[rows] for part, rows in chosen]),
        np.concatenate([part.velocities[rows] for part, rows in chosen]),
        np.concatenate([part.accelerations[rows] for part, rows in chosen]),
    )


def _fill(given: ruckig.InputParameter, q: Array, v: Array, limits: MotionLimits) -> None:
    given.current_position = list(q)
    given.current_velocity = list(v)
    given.max_velocity = list(limits.velocity)
    given.max_acceleration = list(limits.acceleration)
    given.max_jerk = list(limits.jerk)


def _solved(given: ruckig.InputParameter, period: float) -> Motion:
    m = given.degrees_of_freedom
    found = ruckig.Trajectory(m)
    result = ruckig.Ruckig(m).calculate(given, found)
    if result != ruckig.Result.Working:
        raise ArithmeticError(f'Ruckig found no motion for {given}: {result}')
    return _sampled(found, m, period)


def _sampled(found: ruckig.Trajectory, m: int, period: float) -> Motion:
    duration = math.ceil(found.duration / TICK) * TICK
    switches = [k * period for k in range(1, math.ceil(duration / period))]
    for profile in found.profiles[0]:
        switches += accumulate([*profile.brake.t, *profile.t, *profile.accel.t])
        # Turning points too: there the hull of a spline touches the motion, so checks are tight.
        switches += _turning_times(profile)
    times = [0.0]
    for tick in sorted({round(switch / TICK) for switch in switches}):
        time = tick * TICK
        if time - times[-1] >= SHORTEST_STEP and duration - time >= SHORTEST_STEP:
            times.append(time)
    if duration > 0.0:
        times.append(duration)
    states = np.array([found.at_time(time)[:3] for time in times]).reshape(len(times), 3, m)
    return Motion(np.array(times), states[:, 0], states[:, 1], states[:, 2])


def _turning_times(profile: ruckig.Profile) -> list[float]:
    """Times (s) at which a joint's speed passes zero.

    Ruckig's own ``position_extrema`` overlooks those in phases of constant acceleration.
    """
    times = []
    begin = 0.0
    for part in (profile.brake, profile, profile.accel):
        speeds, rates = part.v, part.a
        for k, (j, length) in enumerate(zip(part.j, part.t, strict=True)):
            v, a = speeds[k], rates[k]
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
