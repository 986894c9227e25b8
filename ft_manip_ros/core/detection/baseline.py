"""The usual fixed-threshold detector, to compare with: |command - position| too large too long."""

from __future__ import annotations

import numpy as np

from ft_manip_ros.core.detection.recording import Recording

SAMPLES = 3  # in a row


def exceedance(recording: Recording) -> np.ndarray:
    """Least residual (rad or m) of each run of `SAMPLES` messages, shape (K, n); 0 where unknown.

    A fixed threshold raises an alarm at the first message where this exceeds it.
    """
    residual = np.abs(recording.positions - recording.commands)
    residual = np.where(np.isfinite(residual) & recording.present, residual, 0.0)
    out = residual.copy()
    for back in range(1, SAMPLES):
        out[back:] = np.minimum(out[back:], residual[:-back])
        out[:back] = 0.0
    return out


def first_alarm(recording: Recording, threshold: float) -> tuple[int, int] | None:
    """Message and joint of the first alarm at a threshold (rad or m); None without any."""
    rows, joints = np.nonzero(exceedance(recording) > threshold)
    return (int(rows[0]), int(joints[0])) if len(rows) else None


def quiet_threshold(recording: Recording) -> float:
    """Least threshold that raises no alarm in this healthy recording."""
    return float(exceedance(recording).max())
