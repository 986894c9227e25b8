"""How well the monitor finds implanted faults, and how quiet it stays without any."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ft_manip_ros.core.detection.baseline import first_alarm, quiet_threshold
from ft_manip_ros.core.detection.evaluation import (
    ALARMS,
    Evaluation,
    Healthy,
    KindResult,
    RocPoint,
)
from ft_manip_ros.core.detection.implant import KINDS, Fault, implant
from ft_manip_ros.core.detection.offline import detect
from ft_manip_ros.core.detection.recording import Recording
from ft_manip_ros.core.detection.settings import MonitorSettings
from ft_manip_ros.core.detection.states import Edge, JointState

SENSITIVITIES = (0.1, 0.2, 0.35, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0)


def evaluate(
    recordings: Sequence[Recording],
    *,
    trials: int,
    seed: int,
    settings: MonitorSettings | None = None,
    kinds: Sequence[str] = tuple(KINDS),
) -> Evaluation:
    """Judge the recordings untouched and with implanted faults.

    Parameters
    ----------
    trials
        Faults of each kind implanted into each recording that allows it.
    seed
        Of where and when.
    kinds
        Kinds of faults to implant, of `KINDS`.
    """
    settings = settings or MonitorSettings()
    healthy = [judge_healthy(recording, settings) for recording in recordings]
    results = {kind: KindResult(kind, KINDS[kind][1].name) for kind in kinds}
    fixed = KindResult('lock, fixed', JointState.LOCKED.name)
    locks: list[tuple[Recording, Recording, Fault]] = []
    for kind, result in results.items():
        for place, recording in enumerate(recordings):
            rng = np.random.default_rng([seed, place, list(KINDS).index(kind)])
            for _ in range(trials):
                implanted = implant(recording, kind, rng)
                if implanted is None:
                    break
                faulty, fault = implanted
                judge_fault(result, recording, faulty, fault, settings)
                if kind == 'lock':
                    judge_fixed(fixed, recording, faulty, fault)
                    locks.append((recording, faulty, fault))
    roc = [
        _roc_point(recordings, locks, replace(settings, sensitivity=settings.sensitivity * factor))
        for factor in SENSITIVITIES
    ]
    return Evaluation(healthy, list(results.values()), roc, fixed)


def judge_healthy(recording: Recording, settings: MonitorSettings) -> Healthy:
    """Count the alarms in a recording without any fault."""
    _, edges = detect(recording, settings=settings)
    counts = Counter(edge.report.state for edge in edges)
    return Healthy(recording.name, recording.duration / 3600, {s.name: counts[s] for s in ALARMS})


def judge_fault(
    result: KindResult,
    healthy: Recording,
    faulty: Recording,
    fault: Fault,
    settings: MonitorSettings,
) -> None:
    """Run the monitor over one implanted fault and count what it says."""
    monitor, edges = detect(faulty, settings=settings)
    result.trials += 1
    onset = int(faulty.stamps[fault.due])
    name = faulty.joints[fault.joint] if fault.joint >= 0 else None
    serious = (JointState.LOCKED, JointState.RUNAWAY)
    alarms = [edge for edge in edges if edge.report.state in serious]
    if any(edge.report.name != name or edge.stamp < onset for edge in alarms):
        result.wrong += 1
    hit = _first(edges, fault.expected, name, onset)
    if hit is None:
        return
    result.found += 1
    result.latency.append((hit.stamp - onset) * 1e-9)
    result.samples.append(int(np.searchsorted(faulty.stamps, hit.stamp)) - fault.due)
    if fault.expected == JointState.LOCKED:
        noise = 4.0 * np.nan_to_num(monitor.states()[fault.joint].noise)
        result.bound.append(least_latency(healthy, fault, noise))
        truth = healthy.positions[fault.row, fault.joint]
        result.error.append(abs(hit.report.frozen_position - truth))


def judge_fixed(result: KindResult, healthy: Recording, faulty: Recording, fault: Fault) -> None:
    """Run the fixed-threshold detector over the same fault.

    Its threshold is the best there is: the least that is quiet on this very recording.
    """
    result.trials += 1
    alarm = first_alarm(faulty, quiet_threshold(healthy))
    if alarm is None:
        return
    row, joint = alarm
    if joint != fault.joint or row < fault.row:
        result.wrong += 1
        return
    result.found += 1
    result.latency.append((faulty.stamps[row] - faulty.stamps[fault.row]) * 1e-9)
    result.samples.append(row - fault.row)
    result.bound.append(least_latency(healthy, fault, 0.0))


def least_latency(recording: Recording, fault: Fault, noise: float) -> float:
    """Time (s) until the command has moved away from the lock by more than the noise."""
    rest = max(fault.due - 1, 0) if fault.due > fault.row else fault.row
    command = recording.commands[fault.due :, fault.joint]
    away = np.flatnonzero(np.abs(command - recording.commands[rest, fault.joint]) > noise)
    if not len(away):
        return float('nan')
    return float((recording.stamps[fault.due + away[0]] - recording.stamps[fault.due]) * 1e-9)


def _first(edges: Sequence[Edge], state: JointState, name: str | None, onset: int) -> Edge | None:
    for edge in edges:
        mine = name is None or edge.report.name == name
        if mine and edge.report.state == state and edge.stamp >= onset:
            return edge
    return None


def _roc_point(
    recordings: Sequence[Recording],
    locks: Sequence[tuple[Recording, Recording, Fault]],
    settings: MonitorSettings,
) -> RocPoint:
    healthy = [judge_healthy(recording, settings) for recording in recordings]
    false = sum(row.alarms[JointState.LOCKED.name] for row in healthy)
    result = KindResult('lock', JointState.LOCKED.name)
    for recording, faulty, fault in locks:
        judge_fault(result, recording, faulty, fault, settings)
    p50, p99 = np.percentile(result.latency, [50, 99]) if result.latency else (np.nan, np.nan)
    hours = sum(row.hours for row in healthy)
    return RocPoint(settings.sensitivity, false / hours, result.rate, float(p50), float(p99))
