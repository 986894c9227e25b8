"""Faults implanted into healthy recordings, with what the monitor must say of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.detection.recording import Recording
from ft_manip_ros.core.detection.states import JointState

Array = NDArray[np.float64]

LEAST_MOTION = np.deg2rad(1.0)  # rad, commanded after a lock that has to be found

_SWING_TIME = 2_000_000_000  # ns
_SPEED_TIME = 0.04  # s
_MOVING = 0.02  # rad/s, commanded of a joint that counts as moving
_REST = 500_000_000  # ns
_STILL = 1e-5  # rad


@dataclass(frozen=True)
class Fault:
    """One implanted fault.

    Attributes
    ----------
    kind
        Key of `KINDS`.
    joint
        Its column; -1 for the whole message.
    row
        First message that shows it.
    expected
        State that it must lead to.
    due
        First message that can tell: that of a joint locked at rest in which its command leaves.
    """

    kind: str
    joint: int
    row: int
    expected: JointState
    due: int


def moving_rows(recording: Recording, joint: int) -> NDArray[np.int64]:
    """Messages from which on the joint's command still moves by more than `LEAST_MOTION`."""
    command = recording.commands[::-1, joint]
    if not np.isfinite(command).any():
        return np.empty(0, dtype=np.int64)
    filled = np.where(np.isnan(command), -np.inf, command)
    highest = np.maximum.accumulate(filled)[::-1]
    lowest = np.minimum.accumulate(np.where(np.isnan(command), np.inf, command))[::-1]
    rows = np.flatnonzero(highest - lowest > LEAST_MOTION)
    # The monitor may look at the recording before it has to judge it.
    return rows[rows > len(command) // 20]


def command_speed(recording: Recording, joint: int, rows: NDArray[np.int64]) -> Array:
    """Mean speed (rad/s) of the joint's command around each of ``rows``."""
    times = recording.stamps * 1e-9
    last = len(times) - 1
    reach = max(1, round(_SPEED_TIME / float(np.median(np.diff(times)))))
    before, after = np.maximum(rows - reach, 0), np.minimum(rows + reach, last)
    command = recording.commands[:, joint]
    return np.asarray(np.abs(command[after] - command[before]) / (times[after] - times[before]))


def departures(recording: Recording, joint: int) -> NDArray[np.int64]:
    """Messages in which the joint's command leaves a rest of `_REST` and then moves on."""
    rows = moving_rows(recording, joint)
    if not len(rows):
        return rows
    command = recording.commands[:, joint]
    changed = np.flatnonzero(np.abs(np.diff(command)) > _STILL)
    if not len(changed):
        return changed
    leaves = changed[1:][np.diff(recording.stamps[changed]) > _REST] + 1
    return np.intersect1d(leaves, rows)


def lock(recording: Recording, rng: np.random.Generator, joint: int, row: int) -> Recording:
    """Hold the measured position bit for bit while the command goes on."""
    return _held(recording, joint, row, np.zeros(len(recording.stamps) - row))


def noisy_lock(recording: Recording, rng: np.random.Generator, joint: int, row: int) -> Recording:
    """Hold the position under the encoder's own noise, as seen in its least second differences."""
    reported = recording.positions[recording.present[:, joint], joint]
    bend = np.abs(np.diff(reported, 2))
    # Most of them are motion where samples are rare: the least twentieth shows the noise.
    noise = float(np.quantile(bend, 0.05)) / (0.0627 * np.sqrt(6.0)) if len(bend) else 0.0
    return _held(recording, joint, row, rng.normal(0.0, 1.0, len(recording.stamps) - row) * noise)


def stale(recording: Recording, rng: np.random.Generator, joint: int, row: int) -> Recording:
    """Leave the joint out of the messages."""
    present = recording.present.copy()
    present[row:, joint] = False
    return replace(recording, present=present)


def not_a_number(
    recording: Recording, rng: np.random.Generator, joint: int, row: int
) -> Recording:
    """Report NaN for one joint, from now on."""
    positions = recording.positions.copy()
    positions[row:, joint] = np.nan
    return replace(recording, positions=positions)


def misframed(recording: Recording, rng: np.random.Generator, joint: int, row: int) -> Recording:
    """Report nonsense for one joint in three messages out of ten."""
    positions = recording.positions.copy()
    hit = row + np.flatnonzero(rng.random(len(positions) - row) < 0.3)
    hit = np.union1d(hit, [row])
    positions[hit, joint] = rng.choice([253.0, 1e184, -4.1e7], len(hit))
    return replace(recording, positions=positions)


def run_away(recording: Recording, rng: np.random.Generator, joint: int, row: int) -> Recording:
    """Swing away from the command, ever faster, to 1.5 rad beside it."""
    positions = recording.positions.copy()
    t = (recording.stamps[row:] - recording.stamps[row]) * 1e-9
    sign = rng.choice([-1.0, 1.0])
    positions[row:, joint] += sign * np.minimum(t * t, 1.5)
    return replace(recording, positions=positions)


def frozen_payload(
    recording: Recording, rng: np.random.Generator, joint: int, row: int
) -> Recording:
    """Repeat one whole payload while the stamps go on."""
    out = {}
    for key in ('positions', 'velocities', 'efforts'):
        values = getattr(recording, key).copy()
        values[row:] = values[row]
        out[key] = values
    return replace(recording, **out)


def _held(recording: Recording, joint: int, row: int, noise: Array) -> Recording:
    positions = recording.positions.copy()
    velocities = recording.velocities.copy()
    positions[row:, joint] = positions[row, joint] + noise
    given = np.isfinite(velocities[row:, joint])
    velocities[row:, joint][given] = 0.0
    return replace(recording, positions=positions, velocities=velocities)


Implant = Callable[[Recording, np.random.Generator, int, int], Recording]
KINDS: dict[str, tuple[Implant, JointState]] = {
    'lock': (lock, JointState.LOCKED),
    'lock at rest': (noisy_lock, JointState.LOCKED),
    'noisy lock': (noisy_lock, JointState.LOCKED),
    'stale': (stale, JointState.STALE),
    'not a number': (not_a_number, JointState.SENSOR),
    'misframed': (misframed, JointState.SENSOR),
    'run away': (run_away, JointState.RUNAWAY),
    'frozen payload': (frozen_payload, JointState.STALE),
}


def implant(
    recording: Recording, kind: str, rng: np.random.Generator
) -> tuple[Recording, Fault] | None:
    """Implant one fault of a kind at a random joint and time; None where none fits.

    Locks go into joints that are commanded to move, and by more than `LEAST_MOTION` from there
    on; those at rest go between two motions.
    """
    function, expected = KINDS[kind]
    n, count = len(recording.joints), len(recording.stamps)
    if expected in (JointState.LOCKED, JointState.RUNAWAY):
        places = {joint: _places(recording, kind, joint) for joint in range(n)}
        joints = [joint for joint, rows in places.items() if len(rows)]
        if not joints:
            return None
        joint = int(rng.choice(joints))
        due = row = int(rng.choice(places[joint]))
        if kind == 'lock at rest':
            row = int(np.searchsorted(recording.stamps, recording.stamps[due] - _REST // 2))
    else:
        joint = int(rng.integers(n))
        due = row = int(rng.integers(count // 3, count - count // 10))
    faulty = function(recording, rng, joint, row)
    return faulty, Fault(kind, -1 if kind == 'frozen payload' else joint, row, expected, due)


def _places(recording: Recording, kind: str, joint: int) -> NDArray[np.int64]:
    """Messages in which a fault of a kind can begin or, at rest, show."""
    if kind == 'lock at rest':
        return departures(recording, joint)
    rows = moving_rows(recording, joint)
    if kind == 'run away':
        # A swing takes its time.
        return rows[recording.stamps[rows] < recording.stamps[-1] - _SWING_TIME]
    return rows[command_speed(recording, joint, rows) > _MOVING] if len(rows) else rows
