"""Compiled: command history, and on-line learning of each joint's noise and tracking."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.detection.layout import RING

Array = NDArray[np.float64]

_SMALLEST_STEP = 1e-9  # rad or m: smaller differences are rounding, not encoder steps
_NOISE_MEMORY = 500.0  # samples
_LAG_MEMORY = 5.0  # s of motion
_LAG_LEAST = 0.5  # s of motion before a lag is believed
_TRUST_AFTER = 5.0  # s of motion until a joint's own tracking replaces the prior slack
_ENVELOPE_MEMORY = 120.0  # s of motion
_PACE = 20.0  # times the slowest motion: where lag begins to show
_RESTED = 0.3  # s for which a command rests before it departs anew
_AS_GOOD = 1.1  # ratio of variances below which two lags explain the motion alike
_PACE_TIME = 0.1  # s over which a joint's way is compared with its command's
_PACE_MARGIN = 0.3  # of its command's way


@kernel
def remember_command(r: Any, ring_t: Array, ring_c: Array, t: float, c: float) -> None:
    """Append the command ``c`` at time ``t`` to a joint's history; NaN ends it.

    Commands closer than ``ring_step`` are passed over, so that the history is longer than every
    lag, whatever the sample rate.
    """
    if np.isnan(c):
        r.ring_n = 0
        r.command = c
        r.command_speed = 0.0
        return
    if r.ring_n > 0:
        newest = (r.ring_head - 1) % RING
        dt = t - ring_t[newest]
        if dt <= 0.0:
            return
        if dt > 1.0:
            # A gap: nothing is known of the command in between.
            r.ring_n = 0
        elif dt < r.ring_step:
            r.command = c
            return
    if not np.isnan(r.command) and r.ring_n > 0:
        newest = (r.ring_head - 1) % RING
        r.command_speed = (c - ring_c[newest]) / (t - ring_t[newest])
    else:
        r.command_speed = 0.0
    ring_t[r.ring_head] = t
    ring_c[r.ring_head] = c
    r.ring_head = (r.ring_head + 1) % RING
    r.ring_n = min(r.ring_n + 1, RING)
    r.command = c
    if np.isnan(r.command_rest_value) or abs(c - r.command_rest_value) > 0.1 * r.still_least:
        r.command_moves = r.ring_n > 1
        if r.ring_n == 1 or t - r.command_rest_since > _RESTED:
            r.departed = t
            r.depart_q = r.q
            r.taken_up = False
        r.command_rest_value = c
        r.command_rest_since = t


@kernel
def command_at(r: Any, ring_t: Array, ring_c: Array, t: float) -> float:
    """Command at time ``t`` by linear interpolation; NaN before the history begins."""
    if r.ring_n == 0:
        return np.nan
    k = (r.ring_head - 1) % RING
    if t >= ring_t[k]:
        return ring_c[k]
    # Samples are nearly uniform: guess, then walk.
    back = 0
    if r.period > 0.0:
        back = min(max(int((ring_t[k] - t) / max(r.period, r.ring_step)) - 1, 0), r.ring_n - 1)
        while back > 0 and ring_t[(r.ring_head - 1 - back) % RING] < t:
            back -= 1
    while back < r.ring_n:
        k = (r.ring_head - 1 - back) % RING
        if ring_t[k] <= t:
            after = (k + 1) % RING
            part = (t - ring_t[k]) / (ring_t[after] - ring_t[k])
            return ring_c[k] + part * (ring_c[after] - ring_c[k])
        back += 1
    return np.nan


@kernel
def noise_of(r: Any) -> float:
    """Learned standard deviation of the position noise; 0 before any is learned."""
    if r.noise_n >= 30:
        return np.sqrt(r.noise_var)
    variance = np.inf
    if r.rough_n >= 30:
        variance = r.rough_var
    if r.follow_n >= 30:
        variance = min(variance, r.follow_var)
    return np.sqrt(variance) if variance < np.inf else 0.0


@kernel
def learn_noise(r: Any, t: float, q: float) -> None:
    """Learn quantum and noise from differences of consecutive healthy samples.

    At rest first differences show the noise. In motion second ones do, once the sample rate is
    high enough for the acceleration not to matter, and so do those of the tracking residual
    (`learn_tracking`); both err upwards only. Those at rest are preferred.
    """
    d = q - r.q_1
    size = abs(d)
    if size > _SMALLEST_STEP:
        r.quantum = min(size, 1.0005 * r.quantum) if r.quantum > 0.0 else size
    resting = r.ring_n > 0 and t - r.command_rest_since > 0.3 + r.lag_high
    # The command that is known need not be the one that the arm has.
    if resting and abs(q - r.drift_q) < r.slack:
        square = 0.5 * d * d
        if r.noise_n > 30:
            square = min(square, 25.0 * r.noise_var + r.quantum * r.quantum)
        r.noise_n += 1
        r.noise_var += (square - r.noise_var) / min(float(r.noise_n), _NOISE_MEMORY)
    dt, dt_1 = t - r.t_1, r.t_1 - r.t_2
    if abs(dt - dt_1) < 0.2 * dt:
        bend = d - (r.q_1 - r.q_2)
        square = bend * bend / 6.0
        if r.rough_n > 30:
            square = min(square, 25.0 * r.rough_var + r.quantum * r.quantum)
        r.rough_n += 1
        r.rough_var += (square - r.rough_var) / min(float(r.rough_n), _NOISE_MEMORY)


@kernel
def _watch_pace(r: Any, ring_t: Array, ring_c: Array, most: float, t: float, q: float) -> None:
    """Note whether the joint moves as its command did at some lag up to ``most`` (s).

    A late joint does, however late it is. One that drifts against its command passes for a while
    through the same places, but not at the same speed: it falls back, stands, or moves the other
    way. So a greater lag is learned only from joints that keep pace.
    """
    since = t - r.pace_t
    if since < _PACE_TIME:
        return
    least, greatest = np.inf, -np.inf
    for lag in (0.0, 0.5 * most, most):
        way = command_at(r, ring_t, ring_c, t - lag) - command_at(
            r, ring_t, ring_c, r.pace_t - lag
        )
        # Comparisons with an unknown command are false.
        if way < least:
            least = way
        if way > greatest:
            greatest = way
    margin = _PACE_MARGIN * max(abs(least), abs(greatest))
    r.keeps_pace = least - margin <= q - r.pace_q <= greatest + margin
    r.pace_t = t
    r.pace_q = q


@kernel
def _learn_envelope(
    r: Any, ring_t: Array, ring_c: Array, t: float, where: float, dt: float
) -> None:
    """Learn how far the joint strays from its command: what no believable lag explains.

    Lag itself is allowed for where evidence is weighed.

    Parameters
    ----------
    where
        Position less the learned offset, rad or m.
    """
    early = command_at(r, ring_t, ring_c, t - r.lag_low)
    late = command_at(r, ring_t, ring_c, t - r.lag_high)
    c = command_at(r, ring_t, ring_c, t - r.lag)
    if not np.isnan(late):
        c = min(max(where, min(early, late)), max(early, late))
    away = max(abs(where - c) - 3.0 * noise_of(r), 0.0)
    r.envelope = max(away, r.envelope * (1.0 - dt / _ENVELOPE_MEMORY))


@kernel
def learn_tracking(
    r: Any, ring_t: Array, ring_c: Array, mean: Array, var: Array, lags: Array, t: float, q: float
) -> None:
    """Learn lag, offset and residual envelope of one joint while its command moves.

    Every candidate lag keeps mean and variance of ``q - c(t - lag)``; the least variance wins,
    refined by a parabola.
    """
    if r.ring_n < 3 or abs(r.command_speed) < r.moving_speed:
        return
    _watch_pace(r, ring_t, ring_c, lags[-1], t, q)
    near = True
    if r.lag_known:
        reach = 0.5 * r.runaway_distance
        low = high = command_at(r, ring_t, ring_c, t - r.lag)
        near = abs(q - r.offset - low) <= reach
        for lag in (0.0, 0.5 * lags[-1], lags[-1]):
            c = command_at(r, ring_t, ring_c, t - lag)
            low, high = min(low, c), max(high, c)
        if not near and not (r.keeps_pace and low - reach <= q - r.offset <= high + reach):
            # Too far away to be taken for tracking, or leaving: nothing of this is learned.
            return
    dt = min(t - r.t_1, 0.2)
    # Slow motion says little about lag, and much about sag and friction.
    pace = r.command_speed / (_PACE * r.moving_speed)
    dt *= pace * pace / (1.0 + pace * pace)
    r.moved_s += dt
    weight = dt / min(r.moved_s, _LAG_MEMORY)
    count = lags.shape[0]
    best = 0
    for i in range(count):
        c = command_at(r, ring_t, ring_c, t - lags[i])
        if np.isnan(c):
            return
        e = q - c
        step = e - mean[i]
        mean[i] += weight * step
        var[i] = (1.0 - weight) * (var[i] + weight * step * step)
        if var[i] < var[best]:
            best = i
    step = r.command - r.command_mean
    r.command_mean += weight * step
    var[count] = (1.0 - weight) * (var[count] + weight * step * step)
    if r.moved_s < _LAG_LEAST or var[best] > 0.2 * var[count]:
        return
    lag = lags[best]
    if 0 < best < count - 1:
        x0, x1, x2 = lags[best - 1], lags[best], lags[best + 1]
        s0 = (var[best] - var[best - 1]) / (x1 - x0)
        s1 = (var[best + 1] - var[best]) / (x2 - x1)
        bend = (s1 - s0) / (x2 - x0)
        if bend > 0.0:
            lag = 0.5 * (x0 + x1) - 0.5 * s0 / bend
            lag = min(max(lag, x0), x2)
    # Every lag that explains the motion nearly as well is still believable.
    first, last = best, best
    bound = _AS_GOOD * var[best] + noise_of(r) ** 2
    while first > 0 and var[first - 1] <= bound:
        first -= 1
    while last < count - 1 and var[last + 1] <= bound:
        last += 1
    margin = max(max(1.5 * r.period, 0.006), 0.25 * lag)
    r.lag = lag
    r.lag_low = max(0.0, min(lag - margin, lags[first]))
    r.lag_high = max(lag + margin, lags[last])
    r.offset = mean[best]
    c = command_at(r, ring_t, ring_c, t - lag)
    step = q - c - r.follow_1
    if r.follow_t == r.t_1:
        square = 0.5 * step * step
        if r.follow_n > 30:
            square = min(square, 25.0 * r.follow_var + r.quantum * r.quantum)
        r.follow_n += 1
        r.follow_var += (square - r.follow_var) / min(float(r.follow_n), _NOISE_MEMORY)
    r.follow_1 = q - c
    r.follow_t = t
    if near:
        _learn_envelope(r, ring_t, ring_c, t, q - r.offset, dt)
    if not r.lag_known:
        r.lag_known = True
        r.lag_first = r.lag_high
    elif r.moved_s < _TRUST_AFTER:
        r.lag_first = max(r.lag_first, r.lag_high)
