"""Motions of piecewise constant jerk in compiled code: where joints are, switch and turn.

A profile is an array of shape (m, 5, P): for each of m joints the length of its P phases, the
jerk in each, and position, speed and acceleration where each begins. The last phase never ends.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ft_manip_ros.core.chain import Array

LENGTH, JERK, POSITION, SPEED, ACCELERATION = range(5)


@njit(cache=True, nogil=True)
def _advanced(t: float, p: float, v: float, a: float, j: float) -> tuple[float, float, float]:
    """Position, speed and acceleration after a time of constant jerk."""
    return p + t * (v + t * (0.5 * a + t * j / 6.0)), v + t * (a + 0.5 * t * j), a + t * j


@njit(cache=True, nogil=True)
def _state(phases: Array, time: float) -> tuple[float, float, float]:
    """State of one joint, phases (5, P), at a time."""
    k = 0
    while k < phases.shape[1] - 1 and time >= phases[LENGTH, k]:
        time -= phases[LENGTH, k]
        k += 1
    return _advanced(
        time, phases[POSITION, k], phases[SPEED, k], phases[ACCELERATION, k], phases[JERK, k]
    )


@njit(cache=True, nogil=True)
def _turns(phases: Array, out: Array) -> int:
    """Write the times at which one joint's speed, phases (5, P), passes zero; returns how many.

    Ruckig's own ``position_extrema`` overlooks those in phases of constant acceleration.
    """
    count, begin = 0, 0.0
    for k in range(phases.shape[1] - 1):
        length = phases[LENGTH, k]
        if length == 0.0:
            continue
        v, a, j = phases[SPEED, k], phases[ACCELERATION, k], phases[JERK, k]
        _, v_end, a_end = _advanced(length, 0.0, v, a, j)
        if v * v_end <= 0.0 or a * a_end < 0.0:
            low, high = _roots(0.5 * j, a, v)
            for root in (low, high):
                if 0.0 < root < length:
                    out[count] = begin + root
                    count += 1
        begin += length
    return count


@njit(cache=True, nogil=True)
def _roots(c2: float, c1: float, c0: float) -> tuple[float, float]:
    """Real roots of c2 t^2 + c1 t + c0; NaN for those that there are not."""
    if c2 == 0.0:
        return (math.nan if c1 == 0.0 else -c0 / c1), math.nan
    inside = c1 * c1 - 4.0 * c2 * c0
    if inside < 0.0:
        return math.nan, math.nan
    # The larger one first, free of cancellation.
    q = -0.5 * (c1 + math.copysign(math.sqrt(inside), c1))
    if q == 0.0:
        return 0.0, 0.0
    return q / c2, c0 / q


@njit(cache=True, nogil=True)
def turning_range(profile: Array) -> tuple[Array, Array]:
    """Lowest and highest position, each (m,), at which joints turn; infinite where none does."""
    m = profile.shape[0]
    low, high = np.full(m, np.inf), np.full(m, -np.inf)
    times = np.empty(2 * profile.shape[2])
    for i in range(m):
        for k in range(_turns(profile[i], times)):
            position = _state(profile[i], times[k])[0]
            low[i], high[i] = min(low[i], position), max(high[i], position)
    return low, high


@njit(cache=True, nogil=True)
def sampled(
    profile: Array, unit: float, duration: float, period: float, tick: float, shortest: float
) -> tuple[Array, Array]:
    """Sample a motion at its start and end, at every switch and turning point, and in between.

    Parameters
    ----------
    profile
        In a ``unit`` of time of so many s.
    duration
        Of the motion (s), a whole number of ticks.
    period
        Longest time between samples (s).
    tick
        Samples are at whole multiples of this (s).
    shortest
        Samples closer together than this (s) become one.

    Returns
    -------
    times : shape (T,)
        s.
    states : shape (T, 3, m)
        Positions, speeds and accelerations.
    """
    m, phases = profile.shape[0], profile.shape[2]
    evenly = max(math.ceil(duration / period) - 1, 0)
    ticks = np.empty(evenly + 3 * m * phases)
    for k in range(evenly):
        ticks[k] = np.rint((k + 1) * period / tick)
    count = evenly
    turns = np.empty(2 * phases)
    for i in range(m):
        end = 0.0
        for k in range(phases - 1):
            end += profile[i, LENGTH, k]
            ticks[count] = np.rint(end * unit / tick)
            count += 1
        # Turning points too: there the hull of a spline touches the motion, so checks are tight.
        for k in range(_turns(profile[i], turns)):
            ticks[count] = np.rint(turns[k] * unit / tick)
            count += 1
    times = np.zeros(count + 2)
    last = 0
    for at in np.sort(ticks[:count]):
        time = at * tick
        if time - times[last] >= shortest and duration - time >= shortest:
            last += 1
            times[last] = time
    if duration > 0.0:
        last += 1
        times[last] = duration
    states = np.empty((last + 1, 3, m))
    for i in range(m):
        for k in range(last + 1):
            position, speed, acceleration = _state(profile[i], times[k] / unit)
            states[k, 0, i] = position
            states[k, 1, i] = speed / unit
            states[k, 2, i] = acceleration / unit**2
    return times[: last + 1].copy(), states


@njit(cache=True, nogil=True)
def line_rates(
    way: Array, smallest: float, velocity: Array, acceleration: Array, jerk: Array
) -> tuple[float, float, float]:
    """Largest rates of a number that runs from 0 to 1 while joints go a straight way, (m,).

    Infinite where no way is as long as ``smallest``; ways of less than that part of the longest
    do not count.
    """
    longest = 0.0
    for i in range(way.shape[0]):
        longest = max(longest, abs(way[i]))
    v = a = j = math.inf
    if longest < smallest:
        return v, a, j
    for i in range(way.shape[0]):
        part = abs(way[i])
        if part > smallest * longest:
            v, a, j = (
                min(v, velocity[i] / part),
                min(a, acceleration[i] / part),
                min(j, jerk[i] / part),
            )
    return v, a, j
