"""The fault monitor over a whole recording, with a trace of its evidence for pictures."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.detection.monitor import FaultMonitor
from ft_manip_ros.core.detection.recording import Recording
from ft_manip_ros.core.detection.settings import MonitorSettings
from ft_manip_ros.core.detection.states import Edge
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.joint import Joint

Array = NDArray[np.float64]


@dataclass
class Trace:
    """Evidence after every message, shapes (K,) and (K, n); grows as messages are taken."""

    joints: tuple[str, ...]
    stamps: list[int]
    positions: list[Array]
    commands: list[Array]
    residuals: list[Array]
    thresholds: list[Array]
    states: list[NDArray[np.int64]]

    @classmethod
    def empty(cls, joints: tuple[str, ...]) -> Trace:
        """Trace of nothing yet."""
        return cls(joints, [], [], [], [], [], [])

    def note(self, monitor: FaultMonitor, stamp: int) -> None:
        """Append the monitor's present evidence."""
        records = monitor.records
        self.stamps.append(stamp)
        self.positions.append(records['q'].copy())
        self.commands.append(records['command'].copy())
        self.residuals.append(records['missing'].copy())
        self.thresholds.append(records['threshold'].copy())
        self.states.append(records['state'].copy())


def watched_joints(
    names: Iterable[str], chain: SerialChain | None
) -> tuple[list[Joint | str], set[str]]:
    """Joints to watch in data with these names, and those that the arm does not have.

    Without an arm nothing is known of any joint; with one, only its joints are watched.

    Raises
    ------
    InputError
        If the arm and the data have no joint in common.
    """
    names = list(names)
    if chain is None:
        return list(names), set()
    known = {joint.name: joint for joint in chain.joints}
    mine = [known[name] for name in names if name in known]
    if not mine:
        raise InputError(
            'joints',
            f'{", ".join(names)} are none of the joints of {chain.name!r}: '
            f'{", ".join(chain.joint_names)}',
        )
    return list(mine), set(names) - set(known)


def select(recording: Recording, joints: Iterable[str]) -> Recording:
    """Recording of some of the joints only."""
    names = tuple(joints)
    columns = [recording.joints.index(name) for name in names]

    def table(values: Any) -> Any:
        return np.ascontiguousarray(values[:, columns])

    return replace(
        recording,
        joints=names,
        positions=table(recording.positions),
        velocities=table(recording.velocities),
        efforts=table(recording.efforts),
        commands=table(recording.commands),
        present=table(recording.present),
    )


def detect(
    recording: Recording,
    *,
    chain: SerialChain | None = None,
    settings: MonitorSettings | None = None,
    exempt: Iterable[str] = (),
    trace: Trace | None = None,
) -> tuple[FaultMonitor, list[Edge]]:
    """Run a new monitor over the recording; commands count as streamed references.

    Parameters
    ----------
    chain
        The arm, without which positions of the tool say nothing.
    trace
        Filled with the evidence after every message where given.

    Raises
    ------
    InputError
        For an arm of which no joint is recorded, or not every one where the tool is.
    """
    joints, _ = watched_joints(recording.joints, chain)
    names = [joint if isinstance(joint, str) else joint.name for joint in joints]
    data = recording if tuple(names) == recording.joints else select(recording, names)
    tool = None if chain is None else data.tool
    monitor = FaultMonitor(
        joints,
        settings,
        exempt=[name for name in exempt if name in names],
        chain=None if tool is None else chain,
    )
    step = 1 if trace is not None or tool is not None else max(len(data.stamps), 1)
    edges: list[Edge] = []
    for start in range(0, len(data.stamps), step):
        rows = slice(start, start + step)
        edges += monitor.block(
            data.stamps[rows],
            data.positions[rows],
            data.velocities[rows],
            data.efforts[rows],
            data.present[rows],
            data.commands[rows],
        )
        if tool is not None and not np.isnan(tool[start]).all():
            monitor.tool_pose(int(data.stamps[start]), tool[start])
        if trace is not None:
            trace.note(monitor, int(data.stamps[start]))
    return monitor, edges
