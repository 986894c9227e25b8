"""Conversions of the fault monitor's messages."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from trajectory_msgs.msg import JointTrajectoryPoint

from ft_manip_ros.nodes.fault_messages import desired_positions


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
