"""Faults that survive a restart: one small JSON file, replaced as a whole or not at all."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ft_manip_ros.core.detection.monitor import FaultMonitor
from ft_manip_ros.core.detection.states import LATCHED, JointState, Report
from ft_manip_ros.core.errors import InputError

_VERSION = 1


def save_faults(path: Path, arm: str, reports: Sequence[Report]) -> None:
    """Write every latched fault; a crash leaves the old file or the new one, never half of one.

    Raises
    ------
    OSError
        Where the folder cannot be written.
    """
    faults = [
        {
            'joint': report.name,
            'state': report.state.name,
            'cause': report.cause,
            'manual': report.manual,
            'position': _number(report.frozen_position),
            'sigma': _number(report.frozen_position_sigma),
            'first_evidence': report.first_evidence,
            'confirmed': report.confirmed,
        }
        for report in reports
        if report.state in LATCHED
    ]
    text = json.dumps({'version': _VERSION, 'arm': arm, 'faults': faults}, indent=2) + '\n'
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f'{path.name}.{os.getpid()}.tmp')
    try:
        with draft.open('w', encoding='utf-8') as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def restore_faults(path: Path, monitor: FaultMonitor) -> list[str]:
    """Give the faults of an earlier run back to ``monitor``; return the joints' names.

    Raises
    ------
    InputError
        For a file that cannot be read or was written for other joints. Forgetting a lock in
        silence is the one thing that must not happen.
    """
    if not path.exists():
        return []
    try:
        content = json.loads(path.read_text(encoding='utf-8'))
        faults = content['faults']
        if content['version'] != _VERSION or not isinstance(faults, list):
            raise ValueError(f'version {content["version"]} is not {_VERSION}')
        read = [_fault(fault) for fault in faults]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            str(path),
            f'is no state file of a fault monitor ({error}); repair or delete it, '
            'or set forget to true',
        ) from None
    for name, *_ in read:
        if name not in monitor.names:
            raise InputError(
                str(path), f'{name!r} is not watched; joints are {", ".join(monitor.names)}'
            )
    for name, state, position, sigma, manual, cause in read:
        monitor.restore(name, state, position, sigma, manual, cause)
    return [name for name, *_ in read]


def _fault(fault: Any) -> tuple[str, JointState, float, float, bool, str]:
    state = JointState[fault['state']]
    position, sigma = _float(fault['position']), _float(fault['sigma'])
    if state not in LATCHED or (state == JointState.LOCKED and not math.isfinite(position)):
        raise ValueError(f'{fault["joint"]} is {state.name} at {position}')
    return str(fault['joint']), state, position, sigma, bool(fault['manual']), str(fault['cause'])


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _float(value: float | None) -> float:
    return math.nan if value is None else float(value)
