"""CSV files of points or poses."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np

from ft_manip_ros.core.errors import InputError

_HEADERS = (['x', 'y', 'z'], ['x', 'y', 'z', 'qx', 'qy', 'qz', 'qw'])


def read_points(path: str | os.PathLike[str]) -> list[list[float]]:
    """Read rows of x, y, z (m) or x, y, z, qx, qy, qz, qw, with or without that header.

    Raises
    ------
    InputError
        Naming the file and the line.
    """
    try:
        text = Path(path).read_text(encoding='utf-8-sig')
    except OSError as error:
        raise InputError(str(path), f'cannot be read: {error.strerror}') from None
    except UnicodeDecodeError:
        raise InputError(str(path), 'is not a text file; CSV is needed') from None
    rows: list[list[float]] = []
    for number, cells in enumerate(csv.reader(text.splitlines()), start=1):
        cells = [cell.strip() for cell in cells]
        if not any(cells) or cells[0].startswith('#'):
            continue
        if not rows and [cell.lower() for cell in cells] in _HEADERS:
            continue
        where = f'{path}:{number}'
        if len(cells) not in (3, 7):
            raise InputError(where, f'has {len(cells)} columns; x,y,z or x,y,z,qx,qy,qz,qw needed')
        if rows and len(cells) != len(rows[0]):
            raise InputError(where, f'has {len(cells)} columns, the lines before {len(rows[0])}')
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            raise InputError(where, f'is not all numbers: {",".join(cells)}') from None
        if not np.isfinite(row).all():
            raise InputError(where, 'contains NaN or infinity')
        rows.append(row)
    if not rows:
        raise InputError(str(path), 'has no points')
    return rows
