"""The `expected.yaml` of a case: what its replay must find, in words that last."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from ft_manip_ros.bags.findings import Finding
from ft_manip_ros.bags.replay import ReplayResult
from ft_manip_ros.core.errors import InputError

_TIME = 0.1  # s
_NUMBER = 5e-3  # rad or m


def expected_of(result: ReplayResult, start: int) -> dict[str, Any]:
    """Content of an `expected.yaml` for a replay; times in s from ``start`` (ns)."""
    return {
        'findings': [
            {
                'kind': finding.kind,
                'about': finding.about,
                'time': round((finding.stamp - start) * 1e-9, 3),
                **{
                    key: round(value, 4) if isinstance(value, float) else value
                    for key, value in finding.values.items()
                },
            }
            for finding in result.replayed
        ]
    }


def check_expected(path: Path, result: ReplayResult) -> list[str]:
    """Return one line for each disagreement of a replay with an `expected.yaml`.

    Raises
    ------
    InputError
        If the file is missing or not such a file.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
    except (OSError, yaml.YAMLError) as error:
        raise InputError(str(path), f'cannot be read ({str(error).splitlines()[0]})') from None
    entries = content.get('findings') if isinstance(content, Mapping) else None
    if not isinstance(entries, list) or not all(isinstance(e, Mapping) for e in entries):
        raise InputError(f'{path}: findings', 'is missing; a list of findings is needed')
    problems = []
    left = list(result.replayed)
    for entry in entries:
        match = next((f for f in left if not _disagreement(entry, f, result.start)), None)
        if match is not None:
            left.remove(match)
            continue
        near = [f for f in left if f.kind == entry.get('kind') and f.about == entry.get('about')]
        found = _disagreement(entry, near[0], result.start) if near else 'nothing of the kind'
        problems.append(
            f'{entry.get("kind")} {entry.get("about")} at {entry.get("time")} s: {found}'
        )
    problems += [f'{finding.kind} {finding.text()} was not expected' for finding in left]
    return problems


def _disagreement(entry: Mapping[str, Any], finding: Finding, start: int) -> str:
    if (finding.kind, finding.about) != (entry.get('kind'), entry.get('about')):
        return 'another thing'
    time = (finding.stamp - start) * 1e-9
    if not _near(entry.get('time'), time, _TIME):
        return f'it was found at {time:.3f} s'
    for key, value in finding.values.items():
        wanted = entry.get(key)
        same = _near(wanted, value, _NUMBER) if isinstance(value, float) else wanted == value
        if not same:
            return f'{key} is {value!r} instead of {wanted!r}'
    return ''


def _near(wanted: Any, value: float, within: float) -> bool:
    return isinstance(wanted, (int, float)) and math.fabs(wanted - value) <= within
