"""A joint that becomes late is SLUGGISH, however late it rests at its goals, and never LOCKED."""

from __future__ import annotations

import numpy as np
import pytest

from ft_manip_ros.core.detection.monitor import FaultMonitor
from ft_manip_ros.core.detection.states import JointState

NAMES = ('a', 'b', 'c')
QUICK = 0.02  # s, how late every joint follows at first
REST = 15.0  # s, after which the arm pauses for a while


def smooth(s):
    s = np.clip(s, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s * s)


def motions(rng, times):
    """Motions of all joints from goal to goal, rests between, and the middle of a long rest."""
    wanted = np.zeros((len(times), len(NAMES)))
    start, stands, pause = 1.0, np.zeros(len(NAMES)), 0.0
    while start < times[-1]:
        goal = rng.uniform(-1.0, 1.0, len(NAMES))
        length = rng.uniform(0.8, 2.5)
        wanted += (goal - stands) * smooth((times - start) / length)[:, None]
        stands = goal
        before = start
        start += length + rng.choice([0.0, 0.1, 0.3, 1.0])
        if before < REST <= start:
            pause = start + 1.0
            start += 2.0
    return wanted, pause


def judge(rng, rate, lag):
    """Feed an arm whose joint b follows ``lag`` (s, per sample) behind; return all edges."""
    times = np.arange(0.0, 50.0, 1.0 / rate)
    wanted, pause = motions(rng, times)
    positions = np.column_stack(
        [np.interp(times - QUICK, times, wanted[:, j]) for j in range(len(NAMES))]
    )
    positions[:, 1] = np.interp(times - lag(times, pause), times, wanted[:, 1])
    positions += 1e-5 * rng.standard_normal(positions.shape)
    nothing = np.full_like(positions, np.nan)
    monitor = FaultMonitor(NAMES)
    stamps = np.round((times + 100.0) * 1e9).astype(np.int64)
    present = np.ones(positions.shape, dtype=bool)
    return monitor.block(stamps, positions, nothing, nothing, present, wanted)


def alarms(edges):
    found = {(e.report.name, e.report.state) for e in edges}
    return {(name, state) for name, state in found if state > JointState.SUSPECT}


@pytest.mark.parametrize('rate', [10.0, 25.0, 50.0, 100.0, 250.0, 1000.0])
@pytest.mark.parametrize('late', [0.22, 0.28])
def test_a_joint_that_falls_behind_little_by_little_is_sluggish(rate, late):
    rng = np.random.default_rng([round(rate), round(100 * late)])

    def lag(times, pause):
        return np.clip(QUICK + 0.1 * (times - pause), QUICK, late)

    for _ in range(2 if rate > 500.0 else 5):
        found = alarms(judge(rng, rate, lag))
        assert found <= {('b', JointState.SLUGGISH)}
        # A few samples of lag more are no news where samples are rare.
        assert found or rate < 50.0


@pytest.mark.parametrize('rate', [25.0, 100.0, 1000.0])
def test_a_joint_that_is_late_all_at_once_after_a_rest_is_never_locked(rate):
    rng = np.random.default_rng(round(rate))

    def lag(times, pause):
        return np.where(times < pause, QUICK, 0.22)

    for _ in range(2 if rate > 500.0 else 5):
        found = alarms(judge(rng, rate, lag))
        assert found <= {('b', JointState.SLUGGISH)}
        assert found or rate < 50.0


@pytest.mark.parametrize('rate', [50.0, 100.0, 250.0])
def test_a_joint_that_drifts_against_its_motion_is_not_taken_for_late(rate):
    rng = np.random.default_rng(round(rate))
    times = np.arange(0.0, 20.0, 1.0 / rate)
    wanted = np.zeros((len(times), len(NAMES)))
    for start, way in ((1.0, 1.0), (3.5, -1.0), (6.0, 1.0)):
        wanted += way * smooth((times - start) / 2.0)[:, None]
    # Then all go straight on at 1 rad/s, 1.6 s long, and rest; b leaves its command on the way.
    wanted -= np.clip(times - 10.0, 0.0, 1.6)[:, None]
    drift = 0.6 * np.maximum(times - 10.9, 0.0)
    positions = np.column_stack(
        [np.interp(times - QUICK, times, wanted[:, j]) for j in range(len(NAMES))]
    )
    positions[:, 1] += drift
    positions += 1e-5 * rng.standard_normal(positions.shape)
    nothing = np.full_like(positions, np.nan)
    monitor = FaultMonitor(NAMES)
    stamps = np.round((times + 100.0) * 1e9).astype(np.int64)
    edges = monitor.block(
        stamps, positions, nothing, nothing, np.ones(positions.shape, dtype=bool), wanted
    )
    assert alarms(edges) == {('b', JointState.RUNAWAY)}
    found = next(e.stamp for e in edges if e.report.state == JointState.RUNAWAY)
    # Granted are 0.25 rad (`runaway_distance`) and half of it more, which may have been learned on
    # the way, the lag with which its command reaches a joint, and 0.1 s that are waited.
    drifted = times[np.searchsorted(drift, 1.5 * 0.25)]
    assert found * 1e-9 - 100.0 <= max(drifted, 11.6 + 0.1) + 0.1 + 2.0 / rate
