"""What the demo prints: one line per event, and a table at the end."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

from ft_manip_ros.nodes.demo_record import Record

_GREEN, _RED, _BOLD, _PLAIN = '\033[32m', '\033[31m', '\033[1m', '\033[0m'


class Timeline:
    """Prints events with the seconds since the demo began."""

    def __init__(self) -> None:
        self._start = time.monotonic()
        self._color = sys.stdout.isatty()

    @property
    def elapsed(self) -> float:
        """Seconds since the demo began."""
        return time.monotonic() - self._start

    def line(self, who: str, text: str, *, good: bool | None = None) -> None:
        """Print one event; ``good`` marks what was to be shown, or that it failed."""
        mark = {None: ' ', True: '+', False: '!'}[good]
        color = {None: '', True: _GREEN, False: _RED}[good]
        self._print(f'{self.elapsed:7.2f} s {mark} {who:<14}{text}', color)

    def heading(self, text: str) -> None:
        """Print the title of a part."""
        self._print(f'\n{text}', _BOLD)

    def _print(self, text: str, color: str) -> None:
        print(f'{color}{text}{_PLAIN}' if color and self._color else text, flush=True)


def tell_run(timeline: Timeline, record: Record) -> None:
    """Print what happened after the lock, by the stamps of the messages."""
    unit = 'm' if record.chain.joints[record.chain.index(record.joint)].prismatic else 'rad'
    began = (record.locked_at - record.started) * 1e-9
    print(f'\n  {record.joint} locked {began:.3f} s into the motion; from then on:')
    rows = [
        ('0 ms', f'it stands at {record.frozen_truth:+.4f} {unit} and ignores commands'),
        (
            f'+{record.detection_latency * 1e3:.0f} ms',
            f'fault_monitor: {record.joint} LOCKED at {record.detected_position:+.4f} '
            f'± {record.detected_sigma:.1g} {unit}: {record.cause}',
        ),
        (
            f'+{record.plan_latency * 1e3:.0f} ms',
            f'replanner: plan published (worked out in {record.compute_time * 1e3:.0f} ms): '
            f'{record.plan_reason}',
        ),
    ]
    for point in record.points:
        if point.planned and point.reached:
            after = (point.at - record.locked_at) * 1e-9
            text = f'{point.name} reached within {point.error * 1e3:.3f} mm'
            rows.append((f'+{after:.2f} s', text))
    for when, text in rows:
        print(f'  {when:>10}  {text}')
    for point in record.points:
        if point.fate == 'reached before':
            print(f'  {"":>10}  {point.name} had been reached before ({point.error * 1e3:.3f} mm)')
        elif not point.planned:
            print(f'  {"":>10}  {point.name} is {point.fate.upper()}: {point.reason}')
    text, good = _verdict(record)
    timeline.line('arm', text, good=good)


def table(records: Sequence[Record], problems: Sequence[Sequence[str]]) -> str:
    """One row per run."""
    head = ('joint', 'frozen at', 'detected', 'planned', 'points', 'worst error', 'verdict')
    rows = [head]
    for record, wrong in zip(records, problems, strict=True):
        promised = [p for p in record.points if p.planned]
        remaining = [p for p in record.points if p.fate != 'reached before']
        rows.append(
            (
                record.joint,
                f'{record.frozen_truth:+.3f}',
                f'+{record.detection_latency * 1e3:.0f} ms',
                f'+{record.plan_latency * 1e3:.0f} ms',
                f'{sum(p.reached for p in promised)} of {len(remaining)} left',
                f'{record.worst_error * 1e3:.3f} mm' if promised else '-',
                'as promised' if not wrong else 'FAILED',
            )
        )
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    lines = [
        '  '.join(f'{cell:<{w}}' for cell, w in zip(row, widths, strict=True)) for row in rows
    ]
    return '\n'.join(f'  {line.rstrip()}' for line in lines)


def _verdict(record: Record) -> tuple[str, bool]:
    remaining = [p for p in record.points if p.fate != 'reached before']
    reached = [p for p in remaining if p.reached and p.planned]
    text = f'{len(reached)} of the {len(remaining)} remaining points reached'
    if reached:
        text += f', the worst within {record.worst_error * 1e3:.3f} mm'
    lost = [p.name for p in remaining if not p.planned]
    if lost:
        text += f'; not reachable or not decided with {record.joint} locked: {", ".join(lost)}'
    return text, all(p.reached for p in remaining if p.planned)
