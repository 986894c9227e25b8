"""Conversions of the fault monitor's messages."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from trajectory_msgs.msg import JointTrajectoryPoint

from ft_manip_ros.core.detection.mimics import Mimic, MimicReport
from ft_manip_ros.nodes.fault_messages import desired_positions, diagnostics_message


@pytest.mark.parametrize(
    ('fields', 'wanted'),
    [
        ({'reference': [1.0, 2.0]}, [1.0, 2.0]),
        ({'desired': [3.0]}, [3.0]),
        ({'reference': [], 'desired': [4.0]}, [4.0]),
        ({'reference': []}, []),
    ],
)
def test_desired_fields_of_a_controller_state_are_read_under_either_name(fields, wanted):
    points = {name: JointTrajectoryPoint(positions=values) for name, values in fields.items()}
    assert desired_positions(SimpleNamespace(**points)) == wanted


@pytest.mark.parametrize(
    ('agrees', 'silent', 'level'),
    [
        (True, False, DiagnosticStatus.OK),
        (False, False, DiagnosticStatus.ERROR),
        (False, True, DiagnosticStatus.STALE),
    ],
)
def test_a_mimic_joint_has_a_status_of_its_own(agrees, silent, level):
    report = MimicReport(Mimic('left', 'right', -1.0, 0.0, True), 0.25, 0.5, agrees)
    summary = DiagnosticStatus(name='summary')
    message = diagnostics_message([], 'arm', 0, summary, silent=silent, mimics=[report])
    first, status = message.status
    assert first.name == 'summary'
    assert (status.level, status.name) == (level, 'fault_monitor: left')
    assert {v.key: v.value for v in status.values} == {'position': '0.25', 'expected': '0.5'}
    assert 'right' in status.message
