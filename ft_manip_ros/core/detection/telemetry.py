"""Public recordings of real arms, in the files in which their authors published them.

A folder given as telemetry may hold any of
- ``recorded_FF_*.mat``: KUKA KR300 (J. Weigand, Robot_Identification; MIT), command included;
- ``tiago_position.csv`` with ``tiago_velocity.csv``, ``tiago_effort.csv``: PAL TIAGo, and
- ``pos_read_data.csv`` with ``curr_data.csv``: Stäubli TX40 (both figaroh-examples; Apache-2.0);
and recordings in the CSV form of `recording`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.io import loadmat

from ft_manip_ros.core.detection.recording import Recording, build_recording
from ft_manip_ros.core.detection.recording_csv import read_csv
from ft_manip_ros.core.errors import InputError

_TX40_PERIOD = 0.0002  # s, from the configuration published with it
_TX40_KEEP = 5  # every fifth sample: 1 kHz


def load_folder(folder: Path) -> list[Recording]:
    """Every recording found below ``folder``, by path.

    Raises
    ------
    InputError
        Where there is none, or one cannot be read.
    """
    if not folder.is_dir():
        raise InputError(str(folder), 'is not a folder')
    found = []
    for path in sorted(folder.rglob('*')):
        if path.match('recorded_FF_*.mat'):
            found.append(load_kr300(path))
        elif path.name == 'tiago_position.csv':
            found.append(load_tiago(path.parent))
        elif path.name == 'pos_read_data.csv':
            found.append(load_tx40(path.parent))
        elif path.suffix == '.csv' and _has_our_header(path):
            found.append(read_csv(path))
    if not found:
        raise InputError(
            str(folder), 'holds no recording: CSV files with columns time and position.NAME'
        )
    return found


def load_kr300(path: Path, *, load_side: bool = False) -> Recording:
    """KUKA KR300, 6 axes, 250 Hz, with command and torque.

    Parameters
    ----------
    path
        A ``recorded_FF_*.mat``.
    load_side
        Read the secondary encoders, of which those of axes 4 to 6 do not exist (always zero).
    """
    record = loadmat(path, squeeze_me=True, struct_as_record=False)['rec']
    side = 'se' if load_side else 'mot'
    return build_recording(
        f'KR300 {path.stem.rpartition("_")[2]}{" load side" if load_side else ""}',
        [f'axis_{i + 1}' for i in range(6)],
        record.time_cont,
        np.deg2rad(getattr(record, f'act_pos_{side}_deg')).T,
        velocities=np.deg2rad(getattr(record, f'act_vel_{side}_deg_per_s')).T,
        efforts=record.act_torque_abs_nm.T,
        commands=np.deg2rad(record.ref_pos_deg).T,
    )


def load_tiago(folder: Path) -> Recording:
    """PAL TIAGo, torso and 7 arm joints, 100 Hz with jitter, no command."""
    tables = [
        np.genfromtxt(folder / f'tiago_{key}.csv', delimiter=',', skip_header=1)
        for key in ('position', 'velocity', 'effort')
    ]
    names = ['torso_lift', *(f'arm_{i + 1}' for i in range(7))]
    position, velocity, effort = (table[:, 1:] for table in tables)
    return build_recording(
        'TIAGo', names, tables[0][:, 0], position, velocities=velocity, efforts=effort
    )


def load_tx40(folder: Path) -> Recording:
    """Stäubli TX40, 6 joints, 1 kHz (of 5 kHz), motor current as effort, no command."""
    position, current = (
        np.genfromtxt(folder / name, delimiter=',', skip_header=1)[::_TX40_KEEP]
        for name in ('pos_read_data.csv', 'curr_data.csv')
    )
    times = np.arange(len(position), dtype=float) * (_TX40_PERIOD * _TX40_KEEP)
    names = [f'joint_{i + 1}' for i in range(6)]
    return build_recording('TX40', names, times, np.deg2rad(position), efforts=current)


def _has_our_header(path: Path) -> bool:
    with path.open(encoding='utf-8-sig', errors='replace') as file:
        cells = [cell.strip() for cell in file.readline().split(',')]
    return 'time' in cells and any(cell.startswith('position.') for cell in cells)
