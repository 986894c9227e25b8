"""The one gate: no trajectory leaves without passing `check_trajectory`."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.planning.hulls import (
    all_inside,
    hull_accelerations,
    hull_positions,
    hull_velocities,
)
from ft_manip_ros.core.planning.limits import MotionLimits
from ft_manip_ros.core.planning.timing import stopping_range
from ft_manip_ros.core.planning.trajectory import Trajectory

Hull = Callable[..., Array]
Index = NDArray[np.intp]

# Relative slack on rates and absolute slack (rad or m) on positions, for rounding only.
_RATE_SLACK = 1e-3
_POSITION_SLACK = 1e-6
_START_SLACK = 1e-6
# Halvings of a segment whose hull leaves the range before that counts; each makes the hull four
# times tighter.
_HALVINGS = 6
# Seconds in a message are of 32 bits.
_LONGEST = 2**31 - 1


def check_trajectory(
    chain: SerialChain,
    trajectory: Trajectory,
    limits: MotionLimits,
    *,
    frozen: Mapping[str, float],
    start: Array,
    start_velocity: Array,
) -> tuple[str, ...]:
    """Say what is wrong with a trajectory; it may leave only if nothing is.

    Positions, speeds and accelerations are judged on the whole spline that a controller fits
    between the points (the convex hull of its Bernstein coefficients), not at the points alone.
    Where the start state lies outside a limit, or moves so fast that it must leave it, exactly
    what cannot be avoided is allowed.

    Parameters
    ----------
    chain
        The full arm.
    limits
        Of all n joints, in the arm's order.
    frozen
        Positions (rad or m) of the frozen joints; held there exactly, also outside limits.
    start, start_velocity : shape (n,)
        The state that the trajectory must start from.

    Returns
    -------
    tuple of str
        One sentence a problem, naming joint and time; empty for a safe trajectory.
    """
    if trajectory.joint_names != chain.joint_names:
        return (
            f'joint names are {list(trajectory.joint_names)}; '
            f'the arm has {list(chain.joint_names)}',
        )
    arrays = (
        trajectory.times,
        trajectory.positions,
        trajectory.velocities,
        trajectory.accelerations,
    )
    if not all(np.isfinite(values).all() for values in arrays):
        return ('holds NaN or infinity',)
    times = trajectory.times
    if times[0] < 0.0 or np.any(np.diff(times) <= 0.0):
        return ('time stamps do not grow strictly from a first one of 0 or more',)
    if times[-1] > _LONGEST:
        return (f'lasts {times[-1]:.3g} s, a message can say {_LONGEST} s',)
    problems = _frozen_problems(trajectory, frozen)
    healthy = np.array(
        [i for i, name in enumerate(chain.joint_names) if name not in frozen], dtype=np.intp
    )
    if len(healthy):
        problems += _healthy_problems(
            trajectory, healthy, limits.take(healthy), start[healthy], start_velocity[healthy]
        )
    return tuple(problems)


def _frozen_problems(trajectory: Trajectory, frozen: Mapping[str, float]) -> list[str]:
    problems = []
    for name, position in frozen.items():
        if name not in trajectory.joint_names:
            problems.append(f'frozen joint {name!r} is not listed')
            continue
        i = trajectory.joint_names.index(name)
        if np.any(trajectory.positions[:, i] != position):
            problems.append(f'frozen joint {name!r} is commanded away from {position:.6g}')
        if np.any(trajectory.velocities[:, i]) or np.any(trajectory.accelerations[:, i]):
            problems.append(f'frozen joint {name!r} is commanded to move')
    return problems


def _healthy_problems(
    trajectory: Trajectory, healthy: Index, limits: MotionLimits, start: Array, speed: Array
) -> list[str]:
    names = [trajectory.joint_names[i] for i in healthy]
    times = trajectory.times
    q, v, a = (
        np.ascontiguousarray(values[:, healthy])
        for values in (trajectory.positions, trajectory.velocities, trajectory.accelerations)
    )
    problems = []
    for what, given, wanted in (('position', q[0], start), ('velocity', v[0], speed)):
        off = np.abs(given - wanted)
        for i in np.flatnonzero(off > _START_SLACK):
            problems.append(
                f'{names[i]!r} starts with {what} {given[i]:.6g}, measured is {wanted[i]:.6g}'
            )
    # A stop that must begin outside the limits, or cross them, is the only way out.
    low, high = stopping_range(start, speed, limits)
    low = np.minimum(low, limits.lower) - _POSITION_SLACK
    high = np.maximum(high, limits.upper) + _POSITION_SLACK
    low[limits.unlimited], high[limits.unlimited] = -np.inf, np.inf
    fastest = np.maximum(limits.velocity, np.abs(speed)) * (1.0 + _RATE_SLACK)
    hardest = limits.acceleration * (1.0 + _RATE_SLACK)
    judged = (
        (hull_positions, (low, high), 'position'),
        (hull_velocities, (-fastest, fastest), 'velocity'),
        (hull_accelerations, (-hardest, hardest), 'acceleration'),
    )
    inside = len(times) > 1 and all_inside(times, q, v, a, *(bounds for _, bounds, _ in judged))
    for hull, (lower, upper), what in judged[: 0 if inside else len(judged)]:
        for k, (time, excess) in _excesses(hull, times, q, v, a, lower, upper).items():
            problems.append(
                f'{names[k]!r} leaves its {what} range [{lower[k]:.6g}, {upper[k]:.6g}] '
                f'by {excess:.3g} from t = {time:.3f} s on'
            )
    if np.any(np.abs(v[-1]) > _START_SLACK):
        problems.append('does not end at rest')
    return problems


def _excesses(
    hull: Hull, times: Array, q: Array, v: Array, a: Array, lower: Array, upper: Array
) -> dict[int, tuple[float, float]]:
    """First time and largest size of what each joint does outside its range, by joint index."""
    begin = times[:-1] if len(times) > 1 else times
    h = np.diff(times) if len(times) > 1 else np.ones(1)
    ends: tuple[Array, ...] = (q, v, a, q, v, a)
    if len(times) > 1:
        ends = (q[:-1], v[:-1], a[:-1], q[1:], v[1:], a[1:])
    for level in range(_HALVINGS + 1):
        points = hull(h[:, None], *ends)
        beyond = np.maximum(lower - points, points - upper).max(axis=1)
        out = np.any(beyond > 0.0, axis=1)
        if not out.any():
            return {}
        if level == _HALVINGS:
            break
        begin, h, ends = _halved(begin[out], h[out], *(values[out] for values in ends))
    found = {}
    for i in np.flatnonzero(np.any(beyond > 0.0, axis=0)):
        first = int(np.argmax(beyond[:, i] > 0.0))
        found[int(i)] = (float(begin[first]), float(beyond[:, i].max()))
    return found


def _halved(
    begin: Array, h: Array, q0: Array, v0: Array, a0: Array, q1: Array, v1: Array, a1: Array
) -> tuple[Array, Array, tuple[Array, ...]]:
    """Both halves of each quintic segment, in time order."""
    dt = h[:, None]
    q = 0.5 * (q0 + q1) + 5.0 / 32.0 * dt * (v0 - v1) + dt**2 / 64.0 * (a0 + a1)
    v = 15.0 / 8.0 * (q1 - q0) / dt - 7.0 / 16.0 * (v0 + v1) + dt / 32.0 * (a1 - a0)
    a = 1.5 * (v1 - v0) / dt - 0.25 * (a0 + a1)
    pairs = ((q0, q), (v0, v), (a0, a), (q, q1), (v, v1), (a, a1))
    ends = tuple(np.stack(pair, axis=1).reshape(-1, q.shape[1]) for pair in pairs)
    starts = np.stack([begin, begin + 0.5 * h], axis=1).reshape(-1)
    return starts, np.repeat(0.5 * h, 2), ends
