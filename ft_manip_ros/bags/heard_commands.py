"""Commands where the recorded fault monitor took them, which may be later than they were sent."""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.bags.replay_setup import ReplaySetup
from ft_manip_ros.core.detection.feed import MonitorFeed
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.nodes.conversions import nanoseconds, trajectory_points

TRAJECTORY = (
    'joint_trajectory_controller/joint_trajectory',
    'trajectory_msgs/msg/JointTrajectory',
)
PLAN = 'ft_manip_interfaces/msg/RecoveryPlan'
PLANS = ('replanner/task_plan', 'recovery_plan')
_HEARD = ('fault_monitor/commands_heard', 'ft_manip_interfaces/msg/CommandHeard')


class HeardCommands:
    """Trajectories that wait for the joint state after which the monitor took them.

    Parameters
    ----------
    heard
        Pairs of a trajectory's start and the stamp of that joint state (ns; 0: the monitor had
        not judged any).
    trajectories
        Messages; the first of each start counts.

    Attributes
    ----------
    starts
        Starts (ns) of all trajectories that are delivered here, and so nowhere else.
    """

    def __init__(self, heard: Iterable[tuple[int, int]], trajectories: Iterable[Any]) -> None:
        after = dict(heard)
        order = {start: k for k, start in enumerate(after)}
        self.starts: set[int] = set()
        self._due: list[tuple[int, int, int, Any]] = []
        self._judged = 0
        for message in trajectories:
            start = nanoseconds(message.header.stamp)
            if start in after and start not in self.starts:
                self.starts.add(start)
                heapq.heappush(self._due, (after[start], order[start], start, message))

    def before(self, stamps: NDArray[np.int64]) -> int:
        """How many of the next joint states, by their stamps (K,), come before the next command.

        K where none is due among them.
        """
        if not self._due:
            return len(stamps)
        after = self._due[0][0]
        previous = np.concatenate(([self._judged], stamps[:-1]))
        due = (previous == after) | (stamps > after)
        return int(due.argmax()) if due.any() else len(stamps)

    def judged(self, stamp: int) -> None:
        """Note the stamp (ns) of the joint state judged last."""
        self._judged = stamp

    def deliver(self, feed: MonitorFeed) -> None:
        """Give the next command to a monitor."""
        _, _, start, message = heapq.heappop(self._due)
        # The recorded monitor took it; one that was damaged since is left out.
        with suppress(InputError):
            feed.trajectory(start, start, message.joint_names, trajectory_points(message))


def recorded_commands(setup: ReplaySetup) -> HeardCommands:
    """What a bag tells of it; nothing, where it was recorded before the monitor did."""
    heard = setup.topic(*_HEARD)
    if heard is None:
        return HeardCommands((), ())
    bag = setup.bag
    trajectories: list[Any] = []
    sent = setup.topic(*TRAJECTORY)
    if sent is not None:
        trajectories += bag.readable([sent])
    for name in PLANS:
        plan = setup.topic(name, PLAN)
        if plan is not None:
            trajectories += [message.trajectory for message in bag.readable([plan])]
    return HeardCommands(
        ((nanoseconds(m.start), nanoseconds(m.after)) for m in bag.readable([heard])),
        trajectories,
    )
