"""Checkpoints: enough of a search on disk to go on as if it had never been broken off."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ft_manip_ros.core.design.candidate import Candidate
from ft_manip_ros.core.design.problem import DesignProblem
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.whole_file import write_whole

VERSION = 1
# Settings that may differ when a search is taken up again: they change how fast, not what.
_FREE_SETTINGS = ('time_budget', 'workers', 'executor', 'scheduler', 'max_segments', 'shorten')
_PERIOD = 1.0  # s between two writes


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """How far a search has come, everything before ``next`` included.

    Attributes
    ----------
    next
        The first segment (index, slot) that is still to be done.
    states
        State of each chain at that point.
    """

    next: tuple[int, int]
    states: Mapping[int, Mapping[str, Any] | None]
    best: Candidate | None
    iterations: int
    evaluations: int
    elapsed: float


class CheckpointFile:
    """A checkpoint on disk, replaced whole at most once a second."""

    def __init__(self, path: str | os.PathLike[str], problem: DesignProblem) -> None:
        self.path = Path(path)
        self._key = fingerprint(problem)
        self._problem = problem
        self._written = -_PERIOD

    def write(self, checkpoint: Checkpoint, *, now: bool = False) -> None:
        """Write, unless the last write is less than a second old and ``now`` is False."""
        if not now and time.monotonic() - self._written < _PERIOD:
            return
        best = checkpoint.best
        document = {
            'version': VERSION,
            'search': self._key,
            'task': self._problem.task.name,
            'next': list(checkpoint.next),
            'states': {str(slot): state for slot, state in checkpoint.states.items()},
            'best': None if best is None else _to_json(best),
            'iterations': checkpoint.iterations,
            'evaluations': checkpoint.evaluations,
            'elapsed': checkpoint.elapsed,
        }
        write_whole(self.path, json.dumps(document))
        self._written = time.monotonic()

    def read(self) -> Checkpoint:
        """Read it back.

        Raises
        ------
        InputError
            Where there is none, it is damaged, or it belongs to another search.
        """
        where = f'checkpoint {self.path}'
        try:
            document = json.loads(self.path.read_text())
            if document['version'] != VERSION:
                raise InputError(where, f'has version {document["version"]}; needs {VERSION}')
            if document['search'] != self._key:
                raise InputError(
                    where,
                    f'belongs to another search (task {document["task"]!r}); task, '
                    'specification, seed and method must be those it was written with',
                )
            best = document['best']
            index, slot = document['next']
            return Checkpoint(
                (int(index), int(slot)),
                {int(slot): state for slot, state in document['states'].items()},
                None if best is None else _candidate(best),
                int(document['iterations']),
                int(document['evaluations']),
                float(document['elapsed']),
            )
        except OSError as error:
            raise InputError(where, f'cannot be read: {error}') from error
        except (json.JSONDecodeError, KeyError, TypeError, ValueError, AttributeError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(where, f'is damaged: {error!r}') from error

    def remove(self) -> None:
        """Remove it, where the search has come to its end."""
        self.path.unlink(missing_ok=True)


def fingerprint(problem: DesignProblem) -> str:
    """Hash of everything that the outcome of a search depends on."""
    settings = {
        key: value for key, value in asdict(problem.settings).items() if key not in _FREE_SETTINGS
    }
    parts = [
        json.dumps(settings, sort_keys=True, default=str),
        json.dumps(asdict(problem.spec), sort_keys=True, default=str),
        json.dumps([repr(goal.region) for goal in problem.task.goals]),
    ]
    digest = hashlib.sha256('\n'.join(parts).encode())
    for array in (problem.space.lower, problem.space.upper, *problem.goals):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _to_json(candidate: Candidate) -> dict[str, Any]:
    return {**asdict(candidate), 'parameters': candidate.parameters.tolist()}


def _candidate(fields: Mapping[str, Any]) -> Candidate:
    return Candidate(
        np.array(fields['parameters'], dtype=float),
        float(fields['penalty']),
        tuple(float(x) for x in fields['goal_penalties']),
        float(fields['temperature']),
        float(fields['acceptance_rate']),
        int(fields['iteration']),
    )
