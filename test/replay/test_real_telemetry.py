"""The fault monitor on recordings of real arms, untouched and with implanted faults."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ft_manip_ros.core.detection.evaluate import evaluate
from ft_manip_ros.core.detection.evaluation import LOCKS
from ft_manip_ros.core.detection.offline import detect
from ft_manip_ros.core.detection.states import JointState
from ft_manip_ros.core.detection.telemetry import load_folder, load_kr300

pytestmark = pytest.mark.telemetry

HEALTHY = {JointState.OK, JointState.IDLE, JointState.SUSPECT}


@pytest.fixture(scope='module')
def recordings(telemetry):
    return load_folder(telemetry)


def test_untouched_recordings_raise_no_alarm(recordings):
    for recording in recordings:
        _, edges = detect(recording)
        assert {edge.report.state for edge in edges} <= HEALTHY, recording.name


def test_without_their_commands_neither(recordings):
    for recording in recordings:
        _, edges = detect(replace(recording, commands=np.full_like(recording.commands, np.nan)))
        assert {edge.report.state for edge in edges} <= HEALTHY, recording.name


def test_implanted_faults_are_found_on_the_right_joint(recordings):
    result = evaluate(recordings, trials=6, seed=5, kinds=(*LOCKS, 'stale', 'misframed'))
    assert result.passed, result.table()
    assert sum(row.trials for row in result.kinds) > 0
    assert [row.wrong for row in result.kinds] == [0] * len(result.kinds)


def test_encoders_that_do_not_exist_are_sensor_faults_beside_healthy_ones(telemetry):
    paths = sorted(telemetry.rglob('recorded_FF_*.mat'))
    if not paths:
        pytest.skip('the telemetry folder has no KR300 recording')
    for path in paths:
        _, edges = detect(load_kr300(path, load_side=True))
        faults = {(e.report.name, e.report.state) for e in edges} - {
            (e.report.name, e.report.state) for e in edges if e.report.state in HEALTHY
        }
        assert faults == {(f'axis_{i}', JointState.SENSOR) for i in (4, 5, 6)}
