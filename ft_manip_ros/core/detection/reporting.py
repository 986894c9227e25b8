"""Reports of joints, read from the monitor's memory."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.detection.states import CAUSE_TEXT, Cause, Edge, JointState, Report
from ft_manip_ros.core.detection.tracking import noise_of


def report_of(
    record: np.void,
    name: str,
    note: str,
    before: JointState,
    changed: int,
    stamp_of: Callable[[float], int],
) -> Report:
    """Report of one joint.

    Parameters
    ----------
    record
        The joint's record, of `layout.JOINT`.
    note
        What a person said when declaring or clearing the fault; may be empty.
    before, changed
        State before the latest change, and its stamp (ns).
    stamp_of
        Turns a time of the record (s) into a stamp (ns), 0 for "never".
    """
    cause = CAUSE_TEXT[Cause(int(record['cause']))]
    noise = noise_of(record)
    return Report(
        name=name,
        state=JointState(int(record['state'])),
        cause=f'{cause}: {note}' if note else cause,
        manual=bool(record['manual']),
        frozen_position=float(record['frozen_q']),
        frozen_position_sigma=float(record['frozen_sigma']),
        first_evidence=stamp_of(record['first_evidence']),
        confirmed=stamp_of(record['confirmed']),
        # As the encoder reports it, not as it was unwrapped.
        position=float(record['q']) - 2.0 * math.pi * int(record['turns']),
        commanded_position=float(record['command']),
        residual=float(record['missing']),
        threshold=float(record['threshold']),
        noise=noise if noise > 0.0 or record['noise_n'] else math.nan,
        suspects=int(record['suspects']),
        previous=before,
        changed=changed,
    )


class Reporter:
    """Reports and changes of state of all joints, with what persons said of them.

    Parameters
    ----------
    names
        The n joints.
    records : ndarray, shape (n,), of `layout.JOINT`
    stamp_of
        Turns a time of a record (s) into a stamp (ns), 0 for "never".
    """

    def __init__(
        self, names: Sequence[str], records: NDArray[np.void], stamp_of: Callable[[float], int]
    ) -> None:
        self.notes = [''] * len(names)
        self._names = names
        self._records = records
        self._stamp_of = stamp_of
        self._changes: list[tuple[JointState, int]] = [(JointState.IDLE, 0)] * len(names)

    def all(self) -> tuple[Report, ...]:
        """What is known of every joint now."""
        return tuple(self._report(j) for j in range(len(self._names)))

    def edge(self, j: int, before: JointState, stamp: int, note: str) -> Edge:
        """Note and return the change of joint ``j`` from ``before`` at ``stamp`` (ns)."""
        self.notes[j] = note
        self._changes[j] = (before, stamp)
        return Edge(stamp, before, self._report(j))

    def _report(self, j: int) -> Report:
        before, changed = self._changes[j]
        return report_of(
            self._records[j], self._names[j], self.notes[j], before, changed, self._stamp_of
        )
