"""Reports of the fault monitor as messages: fault state, diagnostics, markers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from visualization_msgs.msg import Marker, MarkerArray

from ft_manip_interfaces.msg import FaultState, JointFault
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.detection.mimics import MimicReport
from ft_manip_ros.core.detection.states import JointState, Report
from ft_manip_ros.core.kernels import frames
from ft_manip_ros.nodes.conversions import stamp

NODE = 'fault_monitor'

LEVELS = {
    JointState.OK: DiagnosticStatus.OK,
    JointState.IDLE: DiagnosticStatus.OK,
    JointState.SUSPECT: DiagnosticStatus.WARN,
    JointState.LOCKED: DiagnosticStatus.ERROR,
    JointState.STALE: DiagnosticStatus.STALE,
    JointState.SENSOR: DiagnosticStatus.ERROR,
    JointState.RUNAWAY: DiagnosticStatus.ERROR,
    JointState.PROVING: DiagnosticStatus.WARN,
    JointState.SLUGGISH: DiagnosticStatus.WARN,
}
_MARKER_SIZE = 0.08  # m


def fault_message(report: Report) -> JointFault:
    """One joint's report as a message."""
    return JointFault(
        name=report.name,
        state=int(report.state),
        previous_state=int(report.previous),
        stamp=stamp(report.changed),
        cause=report.cause,
        manual=report.manual,
        frozen_position=report.frozen_position,
        frozen_position_sigma=report.frozen_position_sigma,
        first_evidence=stamp(report.first_evidence),
        confirmed=stamp(report.confirmed),
        position=report.position,
        commanded_position=report.commanded_position,
        residual=report.residual,
        threshold=report.threshold,
        noise=report.noise,
    )


def state_message(reports: Sequence[Report], ns: int, sequence: int, frame: str) -> FaultState:
    """All joints' reports as one message."""
    frozen = [report for report in reports if report.state == JointState.LOCKED]
    message = FaultState(
        sequence=sequence,
        joints=[fault_message(report) for report in reports],
        frozen_joints=[report.name for report in frozen],
        frozen_positions=[report.frozen_position for report in frozen],
    )
    message.header.stamp = stamp(ns)
    message.header.frame_id = frame
    return message


def diagnostics_message(
    reports: Sequence[Report],
    hardware: str,
    ns: int,
    summary: DiagnosticStatus,
    *,
    silent: bool,
    mimics: Sequence[MimicReport] = (),
) -> DiagnosticArray:
    """Diagnostics of the node and of every joint, as diagnostic_aggregator expects them."""
    message = DiagnosticArray(status=[summary])
    message.header.stamp = stamp(ns)
    for report in reports:
        level = DiagnosticStatus.STALE if silent else LEVELS[report.state]
        if silent and LEVELS[report.state] == DiagnosticStatus.ERROR:
            level = DiagnosticStatus.ERROR
        message.status.append(
            DiagnosticStatus(
                level=level,
                name=f'{NODE}: {report.name}',
                message=f'{report.state.name}: {report.cause}',
                hardware_id=hardware,
                values=_values(report),
            )
        )
    for mimic in mimics:
        level = DiagnosticStatus.OK if mimic.agrees else DiagnosticStatus.ERROR
        message.status.append(
            DiagnosticStatus(
                level=DiagnosticStatus.STALE if silent else level,
                name=f'{NODE}: {mimic.mimic.name}',
                message=mimic.text,
                hardware_id=hardware,
                values=_key_values({'position': mimic.position, 'expected': mimic.expected}),
            )
        )
    return message


def _values(report: Report) -> list[KeyValue]:
    values = {
        'state': report.state.name,
        'position': report.position,
        'commanded_position': report.commanded_position,
        'residual': report.residual,
        'threshold': report.threshold,
        'noise': report.noise,
        'frozen_position': report.frozen_position,
        'frozen_position_sigma': report.frozen_position_sigma,
        'suspects': report.suspects,
        'manual': report.manual,
    }
    return _key_values(values)


def _key_values(values: Mapping[str, object]) -> list[KeyValue]:
    return [
        KeyValue(key=key, value=f'{value:.9g}' if isinstance(value, float) else str(value))
        for key, value in values.items()
    ]


def fault_markers(
    chain: SerialChain, reports: Sequence[Report], ns: int, frame: str
) -> MarkerArray:
    """A ball and a label on every joint that is locked or runs away; old ones are removed."""
    message = MarkerArray(markers=[Marker(action=Marker.DELETEALL)])
    message.markers[0].header.frame_id = frame
    q = np.array([report.position for report in reports])
    q = np.where(np.isnan(q), 0.0, q)
    axes, origins = np.empty((len(chain.axes), 3)), np.empty((len(chain.axes), 3))
    moved = chain.axis_positions(q)
    frames(chain.arrays, moved, axes, origins, np.empty((3, 3)), np.empty(3))
    # The first axis that a joint moves stands for it.
    first = [[axis.joint for axis in chain.axes].index(k) for k in range(chain.n)]
    for k, report in zip(first, reports, strict=True):
        if report.state not in (JointState.LOCKED, JointState.RUNAWAY):
            continue
        where = ''
        if math.isfinite(report.frozen_position):
            where = f' at {report.frozen_position:.4f}'
        for kind, text, lift in (
            (Marker.SPHERE, '', 0.0),
            (Marker.TEXT_VIEW_FACING, f'{report.name} {report.state.name}{where}', 0.12),
        ):
            marker = Marker(ns=report.name, id=kind, type=kind, action=Marker.ADD, text=text)
            marker.header.frame_id = frame
            marker.header.stamp = stamp(ns)
            marker.pose.position.x = float(origins[k, 0])
            marker.pose.position.y = float(origins[k, 1])
            marker.pose.position.z = float(origins[k, 2]) + lift
            marker.pose.orientation.w = 1.0
            marker.scale.x = marker.scale.y = marker.scale.z = _MARKER_SIZE
            marker.color.a = 0.9
            marker.color.r = 1.0
            marker.color.g = 0.0 if report.state == JointState.RUNAWAY else 0.4
            message.markers.append(marker)
    return message


def desired_positions(message: Any) -> Sequence[float]:
    """Commanded positions of a control_msgs/JointTrajectoryControllerState, rad or m.

    The fields ``desired`` were renamed to ``reference`` between distributions; some have both and
    fill one of them.
    """
    for name in ('reference', 'desired'):
        wanted = getattr(message, name, None)
        if wanted is not None and len(wanted.positions):
            return list(wanted.positions)
    return []
