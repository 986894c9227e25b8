"""Recordings of joint data as CSV files."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.detection.recording import Recording
from ft_manip_ros.core.errors import InputError

Array = NDArray[np.float64]
QUANTITIES = ('position', 'velocity', 'effort', 'command')
_TOOL = ('tool.x', 'tool.y', 'tool.z')


def read_csv(path: Path) -> Recording:
    """Read a CSV with a column ``time`` (s) and ``position.NAME`` and the like.

    ``tool.x``, ``tool.y``, ``tool.z`` (m) are positions of the tool in the arm's base frame.
    Empty cells mean "not in this sample"; an empty command means that the last one holds.

    Raises
    ------
    InputError
        Naming file, line and column, and what would be valid.
    """
    try:
        with path.open(newline='', encoding='utf-8-sig') as file:
            return _read(path, file)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(str(path), f'cannot be read as CSV: {error}') from None


def _read(path: Path, file: TextIO) -> Recording:
    rows = csv.reader(file)
    header = [cell.strip() for cell in next(rows, [])]
    columns, joints = _columns(path, header)
    numbers = list(_numbers(path, rows, header))
    if not numbers:
        raise InputError(str(path), 'has no rows below its header')
    values = np.array([row for row, _ in numbers])
    filled = np.array([given for _, given in numbers])
    tables = {key: np.full((len(values), len(joints)), np.nan) for key in QUANTITIES}
    present = np.zeros((len(values), len(joints)), dtype=np.bool_)
    for k, (quantity, joint) in columns.items():
        tables[quantity][:, joint] = values[:, k]
        if quantity == 'position':
            present[:, joint] = filled[:, k]
    times = values[:, header.index('time')]
    for line, time in enumerate(times, start=2):
        if not math.isfinite(time):
            raise InputError(f'{path}: line {line}: time', f'is {time}; a finite number is needed')
    _hold(tables['command'])
    tool = None
    if _TOOL[0] in header:
        places = [header.index(cell) for cell in _TOOL]
        tool = np.ascontiguousarray(values[:, places])
        some = filled[:, places].any(axis=1) & ~filled[:, places].all(axis=1)
        if some.any():
            line = 2 + int(np.argmax(some))
            raise InputError(f'{path}: line {line}', f'fills some of {", ".join(_TOOL)} only')
    return Recording(
        path.stem,
        joints,
        np.round(times * 1e9).astype(np.int64),
        tables['position'],
        tables['velocity'],
        tables['effort'],
        tables['command'],
        present,
        tool,
    )


def _columns(
    path: Path, header: Sequence[str]
) -> tuple[dict[int, tuple[str, int]], tuple[str, ...]]:
    """Quantity and joint of every data column, and the joints in the order of their positions."""
    if 'time' not in header:
        raise InputError(
            f'{path}: line 1',
            'has no column time; the header is time, position.NAME and, where known, '
            'velocity.NAME, effort.NAME, command.NAME',
        )
    joints = tuple(cell[9:] for cell in header if cell.startswith('position.') and cell[9:])
    if not joints:
        raise InputError(f'{path}: line 1', 'has no column position.NAME')
    if len(set(header)) != len(header):
        twice = sorted({cell for cell in header if header.count(cell) > 1})
        raise InputError(f'{path}: line 1', f'has columns twice: {", ".join(map(repr, twice))}')
    if 0 < len(set(_TOOL) & set(header)) < len(_TOOL):
        raise InputError(f'{path}: line 1', f'has some of {", ".join(_TOOL)} only')
    columns = {}
    for k, cell in enumerate(header):
        if cell == 'time' or cell in _TOOL:
            continue
        quantity, _, joint = cell.partition('.')
        if quantity not in QUANTITIES or joint not in joints:
            raise InputError(
                f'{path}: line 1: column {cell!r}',
                f'is none of time, {", ".join(f"{key}.NAME" for key in QUANTITIES)}, '
                f'{", ".join(_TOOL)}, '
                f'with NAME one of {", ".join(joints)}',
            )
        columns[k] = (quantity, joints.index(joint))
    return columns, joints


def _numbers(
    path: Path, rows: Iterator[list[str]], header: Sequence[str]
) -> Iterator[tuple[list[float], list[bool]]]:
    for line, row in enumerate(rows, start=2):
        if not row:
            continue
        if len(row) != len(header):
            raise InputError(
                f'{path}: line {line}', f'has {len(row)} cells; the header has {len(header)}'
            )
        try:
            yield (
                [float(cell) if cell and not cell.isspace() else math.nan for cell in row],
                [bool(cell) and not cell.isspace() for cell in row],
            )
        except ValueError:
            column, cell = next(
                (name, cell) for name, cell in zip(header, row, strict=True) if not _fits(cell)
            )
            raise InputError(
                f'{path}: line {line}',
                f'column {column!r} is {cell!r}; a number or nothing is needed',
            ) from None


def _fits(cell: str) -> bool:
    """Whether a cell is a number or empty."""
    try:
        float(cell.strip() or 'nan')
    except ValueError:
        return False
    return True


def _hold(commands: Array) -> None:
    """Let each command hold until the next one, in place."""
    for column in commands.T:
        known = np.flatnonzero(~np.isnan(column))
        if len(known):
            latest = np.searchsorted(known, np.arange(len(column)), side='right') - 1
            column[known[0] :] = column[known[latest[known[0] :]]]
