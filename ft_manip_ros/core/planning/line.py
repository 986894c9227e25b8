"""Straight motion of the tool from a posture at rest to a goal, as far as the joints allow it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from ft_manip_ros.core.chain import Array, ChainArrays, SerialChain
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.joint import FULL_TURN
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.planning import timing
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.hulls import hull_accelerations, hull_velocities
from ft_manip_ros.core.planning.limits import MotionLimits, travel
from ft_manip_ros.core.planning.margins import tool_errors
from ft_manip_ros.core.planning.move_times import rest_to_rest_time
from ft_manip_ros.core.planning.postures import find_postures
from ft_manip_ros.core.planning.settings import PlanSettings
from ft_manip_ros.core.planning.timing import Motion

# Postures along a line at first, and how often they are doubled where the tool strays between.
_STEPS = 16
_DOUBLINGS = 3
# A joint that would have to turn more than this (rad or m) in one of the first steps jumps.
_JUMP = 0.7
# How far the tool may stray from the line (m), whatever the goal's own tolerance allows.
_STRAY = 1e-3
_NEAR = 0.05  # rad or m from a limit that counts as at it
_LEAST = 1e-9  # rad or m; who moves less does not move
_POINTS = 2  # trajectory points between two postures


@dataclass(frozen=True, eq=False)
class Line:
    """A straight way of the tool, or how much of it the joints can follow.

    Attributes
    ----------
    start : ndarray, shape (n,)
        Posture of the full arm that it begins in.
    postures : ndarray, shape (K, n)
        Along the line at equal distances, the start first.
    fraction
        Part of the way that was traced, 1 for all of it.
    reason
        Why it ends before the goal; empty where it does not.
    """

    start: Array
    postures: Array
    fraction: float
    reason: str = ''

    @property
    def end(self) -> Array:
        """Last posture, (n,)."""
        return self.postures[-1]

    def motion(
        self, at: Array, healthy: NDArray[np.intp], limits: MotionLimits, period: float
    ) -> Motion:
        """Time the line from rest to rest within speed, acceleration and jerk limits.

        Parameters
        ----------
        at : shape (m,)
            Where the healthy joints stand: the start, or full turns away from it.
        healthy : shape (m,)
            Places of the healthy joints.
        limits
            Of the healthy joints.
        period
            Longest time between samples (s).
        """
        q = at + self.postures[:, healthy] - self.postures[0, healthy]
        count = len(q) - 1
        spline = CubicSpline(np.linspace(0.0, 1.0, count + 1), q)
        slope = np.abs(spline(np.linspace(0.0, 1.0, 4 * count + 1), 1)).max(axis=0)
        if slope.max() * count < _LEAST:
            return timing.move_between(at, at, limits, period)
        rates = np.array([limits.velocity, limits.acceleration, limits.jerk]) / (slope + _LEAST)
        fastest = rates.min(axis=1)
        # The spline bends within a step, so every step gets its points.
        period = min(period, rest_to_rest_time(1.0, *fastest) / (_POINTS * count))
        motion = _along(spline, fastest, period)
        # All rates fall with the powers of the time that the same motion is given.
        slower = _excess(motion, limits)
        if slower > 1.0:
            motion = _along(spline, fastest / slower ** np.arange(1, 4), period * slower)
        return motion


def trace(
    chain: SerialChain,
    arrays: ChainArrays,
    frozen: NDArray[np.bool_],
    start: Array,
    goal: Goal,
    settings: PlanSettings,
    checker: CollisionChecker | None,
) -> Line:
    """Follow the straight line from the tool's place at a posture to a goal.

    The orientation turns evenly about one axis where the goal asks for one; else it is free.

    Parameters
    ----------
    chain
        The full arm.
    arrays
        The same with the limits to obey.
    frozen : shape (n,)
    start : shape (n,)
    """
    line = Line(start, start[None, :], 0.0)
    for doubling in range(_DOUBLINGS + 1):
        steps = _STEPS * 2**doubling
        line = _trace(chain, arrays, frozen, start, goal, settings, checker, steps)
        if line.reason:
            return line
        line = _between(chain, arrays, frozen, line, goal)
        if not line.reason:
            return line
    return line


def _trace(
    chain: SerialChain,
    arrays: ChainArrays,
    frozen: NDArray[np.bool_],
    start: Array,
    goal: Goal,
    settings: PlanSettings,
    checker: CollisionChecker | None,
    steps: int,
) -> Line:
    once = replace(settings, postures=1, attempts=1)
    jump = _JUMP * _STEPS / steps
    places = _places(chain, start, goal)
    postures = [start]
    for k in range(1, steps + 1):
        here, done = postures[-1], (k - 1) / steps
        place = places(k / steps)
        found = find_postures(arrays, frozen, place, here[None, :], once, seed=settings.seed).q
        reason = ''
        if not len(found):
            reason = 'no posture further on was found'
        elif np.abs(step := travel(here, found[0], arrays.wraps)).max() > jump:
            worst = chain.joint_names[int(np.argmax(np.abs(step)))]
            limit = _beyond(chain, arrays, here, frozen, _NEAR)
            reason = f'{worst} would have to jump there'
            reason += f', {limit} being at a limit' if limit else ''
        elif names := _beyond(chain, arrays, here + step, frozen):
            reason = f'{names} would have to pass a limit there'
        elif checker is not None and checker.move_touches(here, here + step):
            reason = f'{checker.what_touches(found[0])} there'
        if reason:
            return Line(start, np.array(postures), done, reason)
        postures.append(here + step)
    return Line(start, np.array(postures), 1.0)


def _places(chain: SerialChain, start: Array, goal: Goal) -> Callable[[float], Goal]:
    """Function from the fraction of the way to what the tool has to be at."""
    rotation, position = fk(chain, start)
    way = goal.position - position
    turn = np.zeros(3)
    if goal.orientation is not None:
        turn = Rotation.from_matrix(goal.orientation @ rotation.T).as_rotvec()
        if goal.free_axis:
            z, wanted = rotation[:, 2], goal.orientation[:, 2]
            turn = Rotation.align_vectors(wanted[None, :], z[None, :])[0].as_rotvec()

    def place(part: float) -> Goal:
        if part == 1.0:
            return goal
        turned = None
        if goal.orientation is not None:
            turned = Rotation.from_rotvec(part * turn).as_matrix() @ rotation
        return replace(goal, position=position + part * way, orientation=turned)

    return place


def _between(
    chain: SerialChain, arrays: ChainArrays, frozen: NDArray[np.bool_], line: Line, goal: Goal
) -> Line:
    """The line, cut off where between two postures the tool leaves it or a joint its range."""
    count = len(line.postures) - 1
    spline = CubicSpline(np.linspace(0.0, 1.0, count + 1), line.postures)
    places = _places(chain, line.start, goal)
    for k in range(count):
        part = (k + 0.5) / count
        distance, turn = tool_errors(chain, spline(part), places(part))
        near = distance <= min(_STRAY, goal.position_tolerance)
        if not near or turn > goal.orientation_tolerance:
            return replace(line, fraction=part, reason='the tool strays from the line there')
        # A cubic is within a thousandth of its reach between samples this close.
        for q in spline((k + np.linspace(0.1, 0.9, 9)) / count):
            if names := _beyond(chain, arrays, q, frozen):
                return replace(line, fraction=part, reason=f'{names} would pass a limit there')
    return line


def _beyond(
    chain: SerialChain,
    arrays: ChainArrays,
    q: Array,
    frozen: NDArray[np.bool_],
    room: float = 0.0,
) -> str:
    """Names of the healthy joints less than ``room`` within their ranges at q, (n,)."""
    ends = ~arrays.wraps | (arrays.upper - arrays.lower > FULL_TURN)
    out = ~frozen & ends & (np.minimum(q - arrays.lower, arrays.upper - q) < room)
    return ' and '.join(chain.joint_names[i] for i in np.flatnonzero(out))


def _along(spline: CubicSpline, rates: Array, period: float) -> Motion:
    """Joint motion along a spline over [0, 1] with these speed, acceleration and jerk, (3,)."""
    none = np.zeros(1, dtype=np.bool_)
    bounds = MotionLimits(np.zeros(1), np.ones(1), none, none, *rates[:, None])
    lead = timing.move_between(np.zeros(1), np.ones(1), bounds, period)
    s = np.clip(lead.positions[:, 0], 0.0, 1.0)
    first, second = spline(s, 1), spline(s, 2)
    velocities = first * lead.velocities
    accelerations = second * lead.velocities**2 + first * lead.accelerations
    return Motion(lead.times, spline(s), velocities, accelerations)


def _excess(motion: Motion, limits: MotionLimits) -> float:
    """Factor, at least 1, by which a motion has to become slower to keep to the limits.

    Speeds and accelerations are judged on the splines between the samples too, as by the gate.
    """
    steps = np.diff(motion.times)[:, None]
    q, v, a = motion.positions, motion.velocities, motion.accelerations
    ends = (q[:-1], v[:-1], a[:-1], q[1:], v[1:], a[1:])
    jerk = np.abs(np.diff(a, axis=0)) / steps
    return max(
        1.0,
        float(np.max(np.abs(hull_velocities(steps, *ends)) / limits.velocity)),
        float(np.max(np.abs(hull_accelerations(steps, *ends)) / limits.acceleration)) ** 0.5,
        float(np.max(jerk / limits.jerk)) ** (1.0 / 3.0),
    )
