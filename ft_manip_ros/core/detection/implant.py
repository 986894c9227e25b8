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
    """

    kind: str
    joint: int
    row: int
    expected: JointState


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

    Locks go where the command still moves by more than `LEAST_MOTION`.
    """
    function, expected = KINDS[kind]
    n, count = len(recording.joints), len(recording.stamps)
    if expected in (JointState.LOCKED, JointState.RUNAWAY):
        joints = [j for j in range(n) if len(moving_rows(recording, j))]
        if not joints:
            return None
        joint = int(rng.choice(joints))
        rows = moving_rows(recording, joint)
        if expected == JointState.RUNAWAY:
            # A swing takes its time.
            rows = rows[recording.stamps[rows] < recording.stamps[-1] - _SWING_TIME]
        row = int(rng.choice(rows))
    else:
        joint = int(rng.integers(n))
        row = int(rng.integers(count // 3, count - count // 10))
    faulty = function(recording, rng, joint, row)
    return faulty, Fault(kind, -1 if kind == 'frozen payload' else joint, row, expected)
