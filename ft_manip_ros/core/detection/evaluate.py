"""How well the monitor finds implanted faults, and how quiet it stays without any."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from ft_manip_ros.core.detection.baseline import first_alarm, quiet_threshold
from ft_manip_ros.core.detection.implant import KINDS, Fault, implant
from ft_manip_ros.core.detection.offline import detect
from ft_manip_ros.core.detection.recording import Recording
from ft_manip_ros.core.detection.settings import MonitorSettings
from ft_manip_ros.core.detection.states import Edge, JointState

ALARMS = (
    JointState.LOCKED,
    JointState.RUNAWAY,
    JointState.SENSOR,
    JointState.STALE,
    JointState.SLUGGISH,
)
SENSITIVITIES = (0.1, 0.2, 0.35, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0)
LOCKS = ('lock', 'noisy lock')
_RATE_WANTED = 0.999


@dataclass
class Healthy:
    """What was said of one untouched recording: how often each alarm was raised."""

    name: str
    hours: float
    alarms: dict[str, int]


@dataclass
class KindResult:
    """How implanted faults of one kind were found.

    Attributes
    ----------
    kind, expected
        The fault and the state that has to follow.
    trials, found
        How many were implanted, and how many led to that state on the right joint.
    wrong
        Trials in which another joint was called LOCKED or RUNAWAY.
    latency, samples, bound
        For each one found: time (s) and messages from the fault to the verdict, and the least
        possible time (s): until the command had moved away by more than the noise.
    error
        For each lock found: distance of the frozen position from the true one, rad or m.
    """

    kind: str
    expected: str
    trials: int = 0
    found: int = 0
    wrong: int = 0
    latency: list[float] = field(default_factory=list)
    samples: list[int] = field(default_factory=list)
    bound: list[float] = field(default_factory=list)
    error: list[float] = field(default_factory=list)

    @property
    def rate(self) -> float:
        """Share of the faults that were found; NaN without trials."""
        return self.found / self.trials if self.trials else float('nan')


@dataclass
class RocPoint:
    """Locks found and missed at one sensitivity, beside false alarms per hour."""

    sensitivity: float
    false_per_hour: float
    rate: float
    latency_p50: float
    latency_p99: float


@dataclass
class Evaluation:
    """Everything that was measured; `table` prints it."""

    healthy: list[Healthy]
    kinds: list[KindResult]
    roc: list[RocPoint]
    fixed: KindResult

    @property
    def passed(self) -> bool:
        """No LOCKED on untouched recordings, and the locks found as they must be."""
        quiet = all(row.alarms[JointState.LOCKED.name] == 0 for row in self.healthy)
        locks = [row for row in self.kinds if row.kind in LOCKS and row.trials]
        return quiet and all(row.rate >= _RATE_WANTED for row in locks)

    def to_json(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {**asdict(self), 'passed': self.passed}

    def table(self) -> str:
        """Text with the tables that people read."""
        lines = ['Untouched recordings: alarms', '']
        heads = [state.name for state in ALARMS]
        lines.append(f'{"recording":<22}{"min":>8}' + ''.join(f'{h:>10}' for h in heads))
        for row in self.healthy:
            counts = ''.join(f'{row.alarms[h]:>10}' for h in heads)
            lines.append(f'{row.name:<22}{row.hours * 60:>8.2f}{counts}')
        lines += ['', 'Implanted faults (times in ms)', '']
        lines.append(
            f'{"kind":<18}{"state":<9}{"n":>6}{"found":>8}{"wrong":>7}{"p50":>8}{"p99":>9}'
            f'{"samples":>9}{"bound":>8}{"excess":>8}{"error":>10}'
        )
        lines += [_kind_line(row) for row in self.kinds if row.trials]
        if self.fixed.trials:
            lines.append(_kind_line(self.fixed))
            lines.append('(fixed: |command - position| over the least threshold quiet before)')
        lines += ['', 'Sensitivity: false LOCKED per hour against locks found', '']
        lines.append(f'{"sensitivity":>11}{"false/h":>10}{"found":>9}{"p50 ms":>9}{"p99 ms":>9}')
        for point in self.roc:
            lines.append(
                f'{point.sensitivity:>11.2f}{point.false_per_hour:>10.1f}{point.rate:>9.4f}'
                f'{point.latency_p50 * 1e3:>9.0f}{point.latency_p99 * 1e3:>9.0f}'
            )
        lines += ['', 'passed' if self.passed else 'FAILED']
        return '\n'.join(lines)


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
    onset = int(faulty.stamps[fault.row])
    name = faulty.joints[fault.joint] if fault.joint >= 0 else None
    serious = (JointState.LOCKED, JointState.RUNAWAY)
    if any(e.report.state in serious and e.report.name != name for e in edges):
        result.wrong += 1
    hit = _first(edges, fault.expected, name, onset)
    if hit is None:
        return
    result.found += 1
    result.latency.append((hit.stamp - onset) * 1e-9)
    result.samples.append(int(np.searchsorted(faulty.stamps, hit.stamp)) - fault.row)
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
    command = recording.commands[fault.row :, fault.joint]
    away = np.flatnonzero(np.abs(command - command[0]) > noise)
    if not len(away):
        return float('nan')
    return float((recording.stamps[fault.row + away[0]] - recording.stamps[fault.row]) * 1e-9)


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


def _kind_line(row: KindResult) -> str:
    line = f'{row.kind:<18}{row.expected:<9}{row.trials:>6}{row.rate:>8.4f}{row.wrong:>7}'
    if row.latency:
        p50, p99 = np.percentile(row.latency, [50, 99]) * 1e3
        line += f'{p50:>8.0f}{p99:>9.0f}{np.median(row.samples):>9.0f}'
    if row.bound:
        excess = np.array(row.latency) - np.array(row.bound)
        line += f'{np.nanmedian(row.bound) * 1e3:>8.0f}{np.nanmedian(excess) * 1e3:>8.0f}'
    if row.error:
        line += f'{max(row.error):>10.1e}'
    return line
