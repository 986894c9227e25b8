"""Joint data of a whole run as arrays, and its CSV form."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.errors import InputError

Array = NDArray[np.float64]
QUANTITIES = ('position', 'velocity', 'effort', 'command')


@dataclass(frozen=True, eq=False)
class Recording:
    """K joint-state messages of n joints.

    Attributes
    ----------
    name
        Where it comes from.
    joints
        Joint names, the columns of all tables.
    stamps : ndarray of int64, shape (K,), ns
    positions, velocities, efforts : ndarray, shape (K, n)
        NaN where not reported (see `present`) or reported as NaN.
    commands : ndarray, shape (K, n)
        Commanded positions at the stamps; NaN where unknown.
    present : ndarray of bool, shape (K, n)
        Whether a message reports a joint's position at all.
    """

    name: str
    joints: tuple[str, ...]
    stamps: NDArray[np.int64]
    positions: Array
    velocities: Array
    efforts: Array
    commands: Array
    present: NDArray[np.bool_]

    @property
    def times(self) -> Array:
        """Stamps in s, shape (K,)."""
        return np.asarray(self.stamps * 1e-9, dtype=float)

    @property
    def duration(self) -> float:
        """Time between first and last message, s."""
        return float((self.stamps[-1] - self.stamps[0]) * 1e-9) if len(self.stamps) else 0.0

    @property
    def commanded(self) -> NDArray[np.bool_]:
        """Which joints have a command, shape (n,)."""
        return np.asarray(np.isfinite(self.commands).any(axis=0))


def build_recording(
    name: str,
    joints: Sequence[str],
    times: Array,
    positions: Array,
    *,
    velocities: Array | None = None,
    efforts: Array | None = None,
    commands: Array | None = None,
) -> Recording:
    """Recording in which every message reports every joint.

    Parameters
    ----------
    times : ndarray, shape (K,), s
    positions, velocities, efforts, commands : ndarray, shape (K, n)
    """

    def table(values: Array | None) -> Array:
        if values is None:
            return np.full(positions.shape, np.nan)
        return np.ascontiguousarray(values, dtype=float)

    return Recording(
        name,
        tuple(joints),
        np.round(np.asarray(times) * 1e9).astype(np.int64),
        table(positions),
        table(velocities),
        table(efforts),
        table(commands),
        np.ones(positions.shape, dtype=np.bool_),
    )


def read_csv(path: Path) -> Recording:
    """Read a CSV with a column ``time`` (s) and ``position.NAME`` and the like.

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
    return Recording(
        path.stem,
        joints,
        np.round(times * 1e9).astype(np.int64),
        tables['position'],
        tables['velocity'],
        tables['effort'],
        tables['command'],
        present,
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
    columns = {}
    for k, cell in enumerate(header):
        if cell == 'time':
            continue
        quantity, _, joint = cell.partition('.')
        if quantity not in QUANTITIES or joint not in joints:
            raise InputError(
                f'{path}: line 1: column {cell!r}',
                f'is none of time, {", ".join(f"{key}.NAME" for key in QUANTITIES)}, '
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
