"""Joint states and commands as they arrive: checked, put on one clock, passed to the monitor.

The node and the replay of bags share this, so that both come to the same verdicts.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.detection.commands import TrajectoryPoint
from ft_manip_ros.core.detection.monitor import FaultMonitor
from ft_manip_ros.core.detection.states import Edge
from ft_manip_ros.core.errors import InputError

_SECOND = 1_000_000_000
_RECENT = 1_000_000_000  # ns, how old a sample may be to tell the samples' clock
_KEPT = 500  # samples: as many as may be queued
Array = NDArray[np.float64]

# Key under which the monitor's diagnostics count the joint states that never came.
MISSED = 'missed joint states'


class MonitorFeed:
    """Takes messages with their arrival times (ns) and keeps the monitor on the stamps' clock.

    Parameters
    ----------
    monitor
        The monitor that is fed.
    frame
        Frame of the arm's base, in which positions of the tool are given; None: any.
    """

    def __init__(self, monitor: FaultMonitor, frame: str | None = None) -> None:
        self.monitor = monitor
        self._frame = frame
        self.ignored: set[str] = set()
        # Stamps and arrivals of the latest samples.
        self._latest: deque[tuple[int, int]] = deque(maxlen=_KEPT)
        self._stamped = False
        self._newest = 0
        self._from_plan = 0

    @property
    def latest(self) -> int:
        """Stamp (ns) of the joint state judged last; 0 before the first."""
        return self._latest[-1][0] if self._latest else 0

    def joint_state(
        self,
        stamp: int,
        arrival: int,
        names: Sequence[str],
        positions: Sequence[float],
        velocities: Sequence[float] = (),
        efforts: Sequence[float] = (),
    ) -> list[Edge]:
        """Take a joint-state message; a driver that never stamps is timed by arrival.

        Raises
        ------
        InputError
            For arrays of another length than ``names``, or names given twice; nothing of the
            message is then used.
        """
        tables = []
        for key, values in (
            ('position', positions),
            ('velocity', velocities),
            ('effort', efforts),
        ):
            if len(values) not in (0, len(names)):
                raise InputError(
                    f'joint_states.{key}', f'has {len(values)} values for {len(names)} names'
                )
            tables.append(dict(zip(names, values, strict=False)))
        if len(set(names)) != len(names):
            raise InputError('joint_states.name', f'{list(names)} names a joint twice')
        self._stamped = self._stamped or stamp != 0
        if not self._stamped:
            stamp = arrival
        mine = [name for name in names if name in self.monitor.names]
        if not mine:
            # Another publisher's joints; the caller may tell.
            self.ignored.update(names)
            return []
        self._latest.append((stamp, arrival))
        return self.monitor.sample(stamp, tables[0], tables[1], tables[2])

    def joint_states(
        self,
        stamps: NDArray[np.int64],
        arrivals: NDArray[np.int64],
        names: Sequence[str],
        positions: Array,
        velocities: Array,
        efforts: Array,
    ) -> list[Edge]:
        """Take K messages of the same m joints; the outcome is that of `joint_state` on each.

        Parameters
        ----------
        stamps, arrivals : ndarray of int64, shape (K,), ns
        names
            Joints of the columns, none twice.
        positions, velocities, efforts : ndarray, shape (K, m), or (K, 0) where not given
        """
        if not stamps.all():
            edges: list[Edge] = []
            for k, (stamp, arrival) in enumerate(
                zip(stamps.tolist(), arrivals.tolist(), strict=True)
            ):
                edges += self.joint_state(
                    stamp, arrival, names, positions[k], velocities[k], efforts[k]
                )
            return edges
        self._stamped = True
        if not any(name in self.monitor.names for name in names):
            self.ignored.update(names)
            return []
        last = slice(-_KEPT, None)
        self._latest.extend(zip(stamps[last].tolist(), arrivals[last].tolist(), strict=True))
        return self.monitor.samples(stamps, names, positions, velocities, efforts)

    def trajectory(
        self,
        stamp: int,
        arrival: int,
        names: Sequence[str],
        points: Iterable[TrajectoryPoint],
    ) -> bool:
        """Take a trajectory; stamp 0 means that it starts as it arrives.

        Returns False, and does nothing, where it was taken from its plan's report already.
        """
        if stamp != 0 and stamp == self._from_plan:
            return False
        start = stamp if stamp != 0 else self.on_sample_clock(arrival)
        self.monitor.trajectory(start, names, list(points))
        self._newest = start
        return True

    def planned(
        self, stamp: int, arrival: int, names: Sequence[str], points: Iterable[TrajectoryPoint]
    ) -> bool:
        """Take the trajectory in a plan's report, where the one sent to the controller was missed.

        Reports are kept for those who listen late, trajectories are not. One that is not newer
        than the newest command, or whose motion is over, says nothing; False is returned then.
        """
        points = list(points)
        if stamp <= self._newest or not points:
            return False
        end = stamp + round(points[-1][0] * _SECOND)
        if self._latest and end < self._latest[-1][0]:
            return False
        self.trajectory(stamp, arrival, names, points)
        self._from_plan = stamp
        return True

    def reference(
        self, stamp: int, arrival: int, names: Sequence[str], positions: Sequence[float]
    ) -> None:
        """Take set points of a reference or controller-state message."""
        if len(positions) != len(names):
            raise InputError(
                'reference.position', f'has {len(positions)} values for {len(names)} names'
            )
        self.monitor.command(
            stamp if stamp != 0 else self.on_sample_clock(arrival),
            dict(zip(names, positions, strict=True)),
        )

    def tool_pose(self, stamp: int, arrival: int, frame: str, position: Sequence[float]) -> None:
        """Take a position (3,), m, of the tool; stamp 0 means that it was seen as it arrives.

        Raises
        ------
        InputError
            For another frame than the arm's base (an empty one is taken for it), and as
            `FaultMonitor.tool_pose`.
        """
        if self._frame is not None and frame not in ('', self._frame):
            raise InputError(
                'tool_pose.header.frame_id',
                f"is {frame!r}; {self._frame!r} (parameter frame), the arm's base, is needed",
            )
        self.monitor.tool_pose(
            stamp if stamp != 0 else self.on_sample_clock(arrival), np.array(position, dtype=float)
        )

    def on_sample_clock(self, arrival: int) -> int:
        """Stamp (ns) that a sample arriving at ``arrival`` without delay would have borne.

        Samples that waited in a queue came later than they might have: those that came soonest
        after their stamps tell.
        """
        soonest = None
        newer = None
        for stamp, came in reversed(self._latest):
            # What is older than a clock that was set back says nothing of the present one.
            if abs(arrival - came) > _RECENT or (newer is not None and stamp > newer + _RECENT):
                break
            newer = stamp
            soonest = stamp - came if soonest is None else max(soonest, stamp - came)
        return arrival + (soonest or 0)
