"""What happens while a plan is made: the arm stops first, and rests until the plan is there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ft_manip_ros.core.planning import timing
from ft_manip_ros.core.planning.route import Route, Visit
from ft_manip_ros.core.planning.timing import Motion
from ft_manip_ros.core.planning.trajectory import Trajectory

# On its way to the controller a trajectory gets this much older (s).
_TRANSFER = 0.02


@dataclass(frozen=True)
class Handover:
    """How the arm is told of a plan that takes longer than a moment.

    A plan among bodies begins with a stop. Sent before the rest is known, that stop is the
    beginning of whatever plan follows, so the controller goes from one to the other without a
    jump; provided that the plan still rests when it comes.

    Attributes
    ----------
    stop
        Called before the search with a checked trajectory that brings a moving arm to rest.
    age
        Returns the age (s) of the measured state that the plan starts from.
    """

    stop: Callable[[Trajectory], None]
    age: Callable[[], float]

    def pause(self, route: Route) -> float:
        """Time (s) that the arm has to rest after its stop for the plan to come in time."""
        missing = max(0.0, self.age() + _TRANSFER - route.stopped)
        return float(np.ceil(missing / timing.TICK) * timing.TICK)


def paused(route: Route, pause: float) -> Route:
    """Return the route with ``pause`` (s) of rest put in where it has stopped."""
    if pause <= 0.0 or not np.isfinite(route.stopped):
        return route
    motion = route.motion
    k = int(np.argmin(np.abs(motion.times - route.stopped)))
    rest = timing.hold(motion.positions[k], pause)
    before, after = _rows(motion, slice(0, k + 1)), _rows(motion, slice(k, None))
    visits = {
        index: Visit(visit.arrival + rest.duration, visit.posture)
        for index, visit in route.visits.items()
    }
    return replace(route, motion=timing.joined([before, rest, after]), visits=visits)


def _rows(motion: Motion, rows: slice) -> Motion:
    times = motion.times[rows]
    return Motion(
        times - times[0],
        motion.positions[rows],
        motion.velocities[rows],
        motion.accelerations[rows],
    )
