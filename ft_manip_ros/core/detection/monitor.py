"""The fault monitor: joint samples and commanded motion in, changes of state out."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.detection.allocation import allocate
from ft_manip_ros.core.detection.command_intake import CommandIntake
from ft_manip_ros.core.detection.commands import TrajectoryPoint
from ft_manip_ros.core.detection.kernel import advance, forget_windows
from ft_manip_ros.core.detection.layout import NO_TIME
from ft_manip_ros.core.detection.machine import freeze, release
from ft_manip_ros.core.detection.plausibility import RANGE_MARGIN
from ft_manip_ros.core.detection.reporting import Reporter
from ft_manip_ros.core.detection.sample_table import sample_table
from ft_manip_ros.core.detection.settings import MonitorSettings
from ft_manip_ros.core.detection.states import Cause, Edge, JointState, Report
from ft_manip_ros.core.detection.tool_watch import ToolWatch
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.joint import Joint

Array = NDArray[np.float64]
_ORIGIN = 1.0  # s, internal time of the first stamp: zero means "never"


class FaultMonitor:
    """Watches every joint of an arm; see `MonitorSettings` for its thresholds.

    Stamps are integers (ns) of one clock. Nothing here reads a clock.

    Parameters
    ----------
    joints
        The joints to watch; limits and speeds of `Joint` are believed. A bare name stands for a
        revolute joint of which nothing is known.
    settings
        Thresholds and windows.
    exempt
        Joints that are never LOCKED, for example a gripper that closes on objects.
    chain
        The arm, where positions of its tool are told (`tool_pose`); all of its joints are watched.

    Attributes
    ----------
    names
        Joint names, in the order of all arrays.
    records
        What is remembered of each joint, shape (n,) of `layout.JOINT`; to look at only.
    tool
        What is known of the tool's motion; None without a chain.
    """

    def __init__(
        self,
        joints: Sequence[Joint | str],
        settings: MonitorSettings | None = None,
        *,
        exempt: Iterable[str] = (),
        chain: SerialChain | None = None,
    ) -> None:
        if not joints:
            raise InputError('joints', 'is empty; at least one joint is needed')
        known = [joint if isinstance(joint, Joint) else Joint(joint) for joint in joints]
        self.names = tuple(joint.name for joint in known)
        self._place = {name: j for j, name in enumerate(self.names)}
        if len(self._place) != len(self.names):
            raise InputError('joints', f'{self.names} name a joint twice')
        self.settings = settings or MonitorSettings()
        exempt = set(exempt)
        for name in exempt:
            self._index(name, 'exempt')
        limited = [isinstance(joint, Joint) for joint in joints]
        self._memory = allocate(known, self.settings, limited, exempt)
        self.records = self._memory.joints
        self.tool: ToolWatch | None = None
        if chain is not None:
            places = np.array([self._index(name, 'tool') for name in chain.joint_names])
            self.tool = ToolWatch(chain, self._memory, places)
        self._intake = CommandIntake(self.names)
        n = len(known)
        self._row = np.full((3, 1, n), np.nan)
        self._present = np.zeros((1, n), dtype=np.bool_)
        self._stamp = np.zeros(1)
        self._edges = np.zeros((n, 2), dtype=np.int64)
        self._scratch = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.bool_)
        self._reporter = Reporter(self.names, self.records, self._stamp_of)
        self._epoch: int | None = None
        self._live_until = -math.inf
        self._resets = 0

    def command(self, stamp: int, positions: Mapping[str, float]) -> None:
        """Take set points that hold from ``stamp`` (ns) on; unknown joints are ignored.

        Raises
        ------
        InputError
            For a position that is not finite; the whole message is then ignored.
        """
        t = self._time(stamp)
        self._intake.reference(t, positions)
        self._live_until = t + 0.5

    def trajectory(
        self,
        stamp: int,
        names: Sequence[str],
        points: Sequence[TrajectoryPoint],
    ) -> None:
        """Take a trajectory that starts at ``stamp`` (ns); without points: hold.

        Parameters and errors are those of `CommandIntake.trajectory`.
        """
        measured = self.records['q'].copy()
        self._intake.trajectory(self._time(stamp), names, points, measured)

    def tool_pose(self, stamp: int, position: Array) -> None:
        """Take a position (3,), m, of the tool in the base frame as seen at ``stamp`` (ns).

        Raises
        ------
        InputError
            For numbers that are not finite, stamps of another clock, or a monitor without chain.
        """
        if self.tool is None:
            raise InputError('tool_pose', 'needs a monitor that was given the arm (chain)')
        self.tool.pose(self._time(stamp), np.asarray(position, dtype=float))

    def sample(
        self,
        stamp: int,
        positions: Mapping[str, float],
        velocities: Mapping[str, float] | None = None,
        efforts: Mapping[str, float] | None = None,
    ) -> list[Edge]:
        """Take one joint-state message; return the changes of state that it caused.

        Unknown joints are ignored; NaN and other nonsense is judged, not refused.
        """
        self._present[:] = False
        self._row[:] = np.nan
        for row, values in enumerate((positions, velocities, efforts)):
            for name, value in (values or {}).items():
                j = self._place.get(name)
                if j is not None:
                    self._row[row, 0, j] = value
                    if row == 0:
                        self._present[0, j] = True
        self._stamp[0] = self._time(stamp)
        command = self._intake.at(self._stamp[0])[None, :]
        return self._advance(self._stamp, self._row, self._present, command, [stamp])

    def samples(
        self,
        stamps: NDArray[np.int64],
        names: Sequence[str],
        positions: Array,
        velocities: Array,
        efforts: Array,
    ) -> list[Edge]:
        """Take K messages of the same m joints at once; the outcome is that of `sample` on each.

        Parameters
        ----------
        stamps : ndarray of int64, shape (K,), ns
        names
            Joints of the columns, none twice; unknown ones are ignored.
        positions, velocities, efforts : ndarray, shape (K, m), or (K, 0) where not given
        """
        count = len(stamps)
        values, present = sample_table(self._place, names, positions, velocities, efforts)
        times = self._times(stamps)
        # Where stamps go back the commands may be forgotten on the way, and where references are
        # streamed they change from sample to sample: one by one, then.
        steady = bool(times[0] > self._memory.arm['now'][0] and (np.diff(times) > 0.0).all())
        live = times < self._live_until
        # And where the tool is seen, the posture of every sample is kept.
        steady = steady and self.tool is None
        step = count if steady and (live.all() or not live.any()) else 1
        edges: list[Edge] = []
        for start in range(0, count, step):
            rows = slice(start, start + step)
            commands = self._intake.over(times[rows])
            edges += self._advance(
                times[rows], values[:, rows], present[rows], commands, stamps[rows].tolist()
            )
        return edges

    def block(
        self,
        stamps: NDArray[np.int64],
        positions: Array,
        velocities: Array,
        efforts: Array,
        present: NDArray[np.bool_],
        commands: Array,
    ) -> list[Edge]:
        """Take K messages at once, columns in the order of `names`; as `sample` one by one.

        Parameters
        ----------
        stamps : ndarray of int64, shape (K,), ns
        positions, velocities, efforts, commands : ndarray, shape (K, n)
            NaN where not given; commands are streamed references.
        present : ndarray of bool, shape (K, n)
        """
        if not len(stamps):
            return []
        first = self._time(int(stamps[0]))
        times = np.asarray((stamps - stamps[0]) * 1e-9 + first, dtype=np.float64)
        self._live_until = math.inf
        return self._advance(
            times, np.stack((positions, velocities, efforts)), present, commands, stamps.tolist()
        )

    def _advance(
        self,
        times: Array,
        values: Array,
        present: NDArray[np.bool_],
        commands: Array,
        stamps: Sequence[int],
    ) -> list[Edge]:
        live = bool(times[0] < self._live_until)
        out = []
        done = 0
        while done < len(times):
            q, v, e = values[:, done:]
            rest = (times[done:], q, v, e, present[done:], commands[done:])
            rows, count = advance(self._memory, *rest, live, self._edges, *self._scratch)
            done += rows
            for j, before in self._edges[:count]:
                out.append(self._reporter.edge(j, JointState(int(before)), stamps[done - 1], ''))
        if self.tool is not None:
            self.tool.sample(float(times[-1]))
        if self._memory.arm['resets'][0] != self._resets:
            self._resets = int(self._memory.arm['resets'][0])
            self._intake.clear()
            if self.tool is not None:
                self.tool.clear()
        return out

    def states(self) -> tuple[Report, ...]:
        """What is known of every joint now."""
        return self._reporter.all()

    def frozen(self) -> dict[str, float]:
        """Positions (rad or m) of all joints that are LOCKED."""
        locked = np.flatnonzero(self.records['state'] == JointState.LOCKED)
        return {self.names[j]: float(self.records['frozen_q'][j]) for j in locked}

    def freeze(self, name: str, position: float | None, reason: str, stamp: int) -> Edge:
        """Declare a joint frozen by hand, at ``position`` or (None) where it was last believed.

        Raises
        ------
        InputError
            For an unknown joint, a position that is not finite or so far beyond the joint's
            limits that a measured one would not be believed, or a joint never seen.
        """
        j = self._index(name, 'joint')
        r = self.records[j]
        if position is not None and not math.isfinite(position):
            raise InputError('position', f'is {position}; a finite number is needed')
        margin = RANGE_MARGIN * (r['upper'] - r['lower'])
        if position is not None and not r['lower'] - margin <= position <= r['upper'] + margin:
            raise InputError(
                'position',
                f'is {position:g}; {name!r} stands between {r["lower"]:.6g} and {r["upper"]:.6g}',
            )
        if position is None and math.isnan(r['q']):
            raise InputError('position', f'of {name!r} was never measured; give one')
        before = JointState(int(r['state']))
        freeze(self._memory.joints[j], self._time(stamp), int(Cause.MANUAL))
        r['manual'] = True
        if position is not None:
            r['frozen_q'] = position
        return self._reporter.edge(j, before, stamp, reason)

    def clear(self, name: str, stamp: int, reason: str = '') -> list[Edge]:
        """Clear a joint's fault, or with an empty name all; each must then prove itself.

        Raises
        ------
        InputError
            For an unknown joint.
        """
        chosen = range(len(self.names)) if not name else [self._index(name, 'joint')]
        edges = []
        for j in chosen:
            r = self.records[j]
            before = JointState(int(r['state']))
            if before not in (JointState.LOCKED, JointState.RUNAWAY):
                continue
            forget_windows(self._memory.joints[j])
            release(self._memory.joints[j])
            edges.append(self._reporter.edge(j, before, stamp, reason))
        return edges

    def restore(
        self,
        name: str,
        state: JointState,
        position: float,
        sigma: float,
        manual: bool,
        reason: str,
    ) -> None:
        """Take over a latched fault that was found before a restart."""
        r = self.records[self._index(name, 'joint')]
        r['state'], r['cause'], r['manual'] = state, Cause.RESTORED, manual
        r['frozen_q'], r['frozen_sigma'] = position, sigma
        self._reporter.notes[self._place[name]] = reason

    def forget_time(self) -> None:
        """Start a new time line (the clock jumped); faults and what was learned stay."""
        for j in range(len(self.names)):
            forget_windows(self._memory.joints[j])
        self._memory.arm['now'] = NO_TIME
        self._intake.clear()
        if self.tool is not None:
            self.tool.clear()

    def _index(self, name: str, field_name: str) -> int:
        if name not in self._place:
            raise InputError(
                field_name, f'{name!r} is not watched; joints are {", ".join(self.names)}'
            )
        return self._place[name]

    def _time(self, stamp: int) -> float:
        if self._epoch is None:
            self._epoch = stamp
        return (stamp - self._epoch) * 1e-9 + _ORIGIN

    def _times(self, stamps: NDArray[np.int64]) -> Array:
        if self._epoch is None:
            self._epoch = int(stamps[0])
        return np.asarray((stamps - self._epoch) * 1e-9 + _ORIGIN, dtype=np.float64)

    def _stamp_of(self, t: float) -> int:
        return 0 if t <= 0.0 or self._epoch is None else self._epoch + round((t - _ORIGIN) * 1e9)
