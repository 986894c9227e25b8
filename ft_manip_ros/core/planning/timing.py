"""Jerk-limited joint motion by Ruckig: stop, move from the moving state, move between rests."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.planning import profiles
from ft_manip_ros.core.planning.limits import MotionLimits, travel
from ft_manip_ros.core.planning.ruckig_solver import Solution, calculate, solve

# Time stamps of ROS messages are whole nanoseconds; states are sampled at exactly those times.
TICK = 1e-9
# Phase switches closer together than this become one point.
SHORTEST_STEP = 2e-5
# Moves shorter than this (rad or m) are no moves.
_SMALLEST_WAY = 1e-9
# Slower than this (rad/s or m/s) is at rest.
_AT_REST = 1e-9
# Samples in a motion that needs no more, however long it is.
_MOST_SAMPLES = 2000


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
    return _sampled(solve(q, v, limits), period)


def stopping_range(q: Array, v: Array, limits: MotionLimits) -> tuple[Array, Array]:
    """Lowest and highest position, each (m,), that the start state makes unavoidable."""
    if not len(q):
        return q, q
    end = solve(q, v, limits).end
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
    direct = _direct(q, v, q + way, limits, stopping_range(q, v, braking))
    if direct is not None:
        return _sampled(direct, period)
    halt = stop(q, v, braking, period)
    rest = halt.positions[-1]
    go = move_between(rest, rest + travel(rest, target, limits.unlimited), limits, period)
    return joined([halt, go])


def arrival_times(
    q: Array, v: Array, targets: Array, limits: MotionLimits, braking: MotionLimits
) -> Array:
    """Durations (s) of `move_from` to each of K targets, (K, m), without the samples."""
    moving = bool(np.any(np.abs(v) > _AT_REST))
    unavoidable = stopping_range(q, v, braking)
    times = []
    for target in targets:
        end = q + travel(q, target, limits.unlimited)
        direct = _direct(q, v, end, limits, unavoidable) if moving else None
        if direct is None:
            times.append(move_from(q, v, target, limits, braking, 10.0).duration)
        else:
            times.append(direct.duration)
    return np.array(times)


def _direct(
    q: Array, v: Array, target: Array, limits: MotionLimits, unavoidable: tuple[Array, Array]
) -> Solution | None:
    """Fastest motion from the moving state to the target; None where it would leave a range."""
    found = calculate(q, v, limits, target)
    if found is None:
        return None
    low, high = profiles.turning_range(found.profile)
    out = low < np.minimum(unavoidable[0], limits.lower) - _SMALLEST_WAY
    out |= high > np.maximum(unavoidable[1], limits.upper) + _SMALLEST_WAY
    return None if np.any(out & ~limits.unlimited) else found


def move_between(q: Array, target: Array, limits: MotionLimits, period: float) -> Motion:
    """Move straight in joint space from rest to rest; a box of limits holds both ends, so all."""
    way = target - q
    rates = profiles.line_rates(
        way, _SMALLEST_WAY, limits.velocity, limits.acceleration, limits.jerk
    )
    if not math.isfinite(rates[0]):
        zero = np.zeros((1, len(q)))
        return Motion(np.zeros(1), q[None, :].copy(), zero, zero)
    times, line = _samples(_unit_way(*rates), period)
    states = line * way
    states[:, 0] += q
    return Motion(times, states[:, 0], states[:, 1], states[:, 2])


def _unit_way(velocity: float, acceleration: float, jerk: float) -> Solution:
    """Fastest motion of one number from 0 to 1 from rest to rest, with these largest rates."""
    begin, end, none = np.zeros(1), np.ones(1), np.zeros(1, dtype=np.bool_)
    rates = [np.array([rate]) for rate in (velocity, acceleration, jerk)]
    return solve(begin, begin, MotionLimits(begin, end, none, none, *rates), end)


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


def _sampled(solution: Solution, period: float) -> Motion:
    times, states = _samples(solution, period)
    return Motion(times, states[:, 0], states[:, 1], states[:, 2])


def _samples(solution: Solution, period: float) -> tuple[Array, Array]:
    """Times, (T,), and states, (T, 3, m), at least so often (s)."""
    duration = math.ceil(solution.duration / TICK) * TICK
    period = max(period, duration / _MOST_SAMPLES)
    times, states = profiles.sampled(
        solution.profile, solution.unit, duration, period, TICK, SHORTEST_STEP
    )
    return times, states
