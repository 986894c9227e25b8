"""The page of a report: one HTML file with everything in it."""

from __future__ import annotations

import base64
import time
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from ft_manip_ros.bags.report_data import OUTCOMES, STATUSES, VERDICTS, ReportData

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 1000px; margin: 2em auto;
       padding: 0 1em; }
h1 { font-size: 1.5em; } h2 { font-size: 1.15em; margin-top: 2em; border-bottom: 1px solid #ccc; }
table { border-collapse: collapse; width: 100%; font-size: 0.9em; }
td, th { text-align: left; padding: 0.25em 0.7em; border-bottom: 1px solid #e5e5e5;
         vertical-align: top; }
td.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
tr.bad td { background: #fdecea; }
img { max-width: 100%; }
.note { background: #fff6dd; padding: 0.5em 1em; margin: 0.4em 0; }
"""


def page(data: ReportData, pictures: dict[str, Path]) -> str:
    """Return the page; pictures are embedded, and nothing is loaded from elsewhere."""
    bag = data.bag
    title = f'Report of {"/".join(bag.path.resolve().parts[-2:])}'
    parts = [
        '<!DOCTYPE html>',
        '<html lang="en"><head><meta charset="utf-8">',
        f'<title>{escape(title)}</title><style>{_STYLE}</style></head><body>',
        f'<h1>{escape(title)}</h1>',
        f'<p>{escape(_summary(data))}</p>',
        *(f'<p class="note">{escape(note)}</p>' for note in data.notes),
        '<h2 id="timeline">Timeline</h2>',
        _table(
            ('time (s)', 'who', 'what'),
            [(f'{e.time:.3f}', e.who, e.text) for e in data.events],
            [event.bad for event in data.events],
        ),
    ]
    for name, path in pictures.items():
        content = base64.b64encode(path.read_bytes()).decode()
        parts.append(f'<h2>{escape(name)}</h2>')
        parts.append(f'<img alt="{escape(name)}" src="data:image/png;base64,{content}">')
    if data.plans:
        parts += ['<h2 id="plans">Plans: what becomes of each goal</h2>', _plans(data)]
    if data.answers:
        parts += ['<h2 id="verdicts">Fault-tolerant work space</h2>', _verdicts(data)]
    parts += ['<h2 id="about">About this bag</h2>', _about(data), '</body></html>']
    return '\n'.join(parts) + '\n'


def _summary(data: ReportData) -> str:
    bag = data.bag
    when = time.strftime('%Y-%m-%d %H:%M:%S UTC', time.gmtime(bag.start * 1e-9))
    locks = ', '.join(f'{joint} locked at {at:.4f}' for _, joint, at in data.locks)
    return (
        f'{bag.message_count} messages over {(bag.end - bag.start) * 1e-9:.1f} s, from {when}. '
        + (f'Faults: {locks}.' if locks else 'No joint locked.')
    )


def _plans(data: ReportData) -> str:
    rows, bad = [], []
    for when, plan in data.plans:
        frozen = ', '.join(
            f'{name} at {position:.4f}'
            for name, position in zip(plan.frozen_joints, plan.frozen_positions, strict=False)
        )
        head = (f'{when:.3f}', frozen or 'nothing frozen', _name(STATUSES, plan.status))
        for goal in plan.goals:
            outcome = _name(OUTCOMES, goal.outcome)
            relaxed = f' ({goal.relaxation})' if goal.relaxation else ''
            rows.append(
                (*head, goal.id or str(goal.index), outcome + relaxed, goal.reason,
                 _millimetres(goal.position_error), f'{goal.arrival:.2f}')
            )  # fmt: skip
            bad.append(outcome in ('lost', 'undecided'))
            head = ('', '', '')
    columns = ('time (s)', 'frozen', 'plan', 'goal', 'outcome', 'reason', 'error (mm)', 'due (s)')
    return _table(columns, rows, bad)


def _verdicts(data: ReportData) -> str:
    rows, bad = [], []
    for _, answer in data.answers:
        p = answer.pose.position
        witness = ', '.join(
            f'{name} at {angle:.4f}'
            for name, angle in zip(answer.joints, answer.angles, strict=False)
        )
        verdict = _name(VERDICTS, answer.verdict)
        rows.append(
            (f'{p.x:.4g}, {p.y:.4g}, {p.z:.4g}', verdict, witness, f'{answer.margin:.3g}',
             answer.reason)
        )  # fmt: skip
        bad.append(verdict != 'member')
    return _table(('point (m)', 'verdict', 'lost with', 'margin (m)', 'reason'), rows, bad)


def _about(data: ReportData) -> str:
    rows = [
        (name, key, value)
        for name, values in sorted(data.bag.provenance.items())
        if name != 'rosbag2'
        for key, value in values.items()
    ]
    topics = [
        (topic, info.type_name, str(info.count)) for topic, info in sorted(data.bag.topics.items())
    ]
    return (
        _table(('topic', 'type', 'messages'), topics)
        + '<details><summary>Parameters and versions</summary>'
        + _table(('of', 'name', 'value'), rows)
        + '</details>'
    )


def _table(
    head: Sequence[str], rows: Iterable[Sequence[str]], bad: Sequence[bool] | None = None
) -> str:
    lines = ['<table><thead><tr>', *(f'<th>{escape(c)}</th>' for c in head), '</tr></thead>']
    lines.append('<tbody>')
    for k, row in enumerate(rows):
        lines.append('<tr class="bad">' if bad is not None and bad[k] else '<tr>')
        for cell in row:
            number = cell.removeprefix('< ').replace('.', '').replace('-', '').isdigit()
            lines.append(f'<td{" class=number" if number else ""}>{escape(cell)}</td>')
        lines.append('</tr>')
    return ''.join([*lines, '</tbody></table>'])


def _millimetres(metres: float) -> str:
    """A length in mm, not finer than a micrometre."""
    return '< 0.001' if metres < 1e-6 else f'{metres * 1e3:.3f}'


def _name(names: tuple[str, ...], number: int) -> str:
    return names[number] if 0 <= number < len(names) else str(number)
