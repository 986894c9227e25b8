"""What an evaluation of the fault monitor measured, and the tables that people read."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from ft_manip_ros.core.detection.states import JointState

ALARMS = (
    JointState.LOCKED,
    JointState.RUNAWAY,
    JointState.SENSOR,
    JointState.STALE,
    JointState.SLUGGISH,
)
LOCKS = ('lock', 'noisy lock', 'lock at rest')
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
        Trials in which another joint, or this one too early, was called LOCKED or RUNAWAY.
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
