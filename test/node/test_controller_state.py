"""The fault monitor beside a joint_trajectory_controller that tells its set points.

Needs `control_msgs`, which comes with every ROS installation that has ros2_control.
"""

from __future__ import annotations

import math

import pytest
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectoryPoint

from ft_manip_interfaces.msg import FaultState, JointFault
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.conversions import stamp
from support.monitored_arm import NAMES

pytestmark = pytest.mark.node

control_msgs = pytest.importorskip('control_msgs.msg')
TOPIC = 'joint_trajectory_controller/controller_state'
PERIOD = 0.01  # s
LAG = 0.02  # s


def wanted(time):
    return [0.3 * math.sin(time + joint) for joint in range(len(NAMES))]


def test_a_lock_is_found_by_the_set_points_of_the_controller(start_node, probe):
    start_node('fault_monitor')
    faults = probe.listen(FaultState, topics.FAULT_STATE, topics.LATCHED_QOS)
    states = probe.publisher(JointState, topics.JOINT_STATES, topics.SENSOR_QOS)
    setpoints = probe.publisher(
        control_msgs.JointTrajectoryControllerState, TOPIC, topics.SENSOR_QOS
    )
    probe.until(lambda: faults and setpoints.get_subscription_count() == 1, 60.0, 'the monitor')
    held = wanted(3.0 - LAG)[1]
    for k in range(500):
        time = PERIOD * k
        at = stamp(10**18 + round(time * 1e9))
        message = control_msgs.JointTrajectoryControllerState(
            joint_names=NAMES, reference=JointTrajectoryPoint(positions=wanted(time))
        )
        message.header.stamp = at
        setpoints.publish(message)
        probe.spin_for(0.002)
        positions = wanted(time - LAG)
        if time >= 3.0:
            positions[1] = held
        state = JointState(name=NAMES, position=positions)
        state.header.stamp = at
        states.publish(state)
        probe.spin_for(0.002)
        if time < 3.0:
            assert not faults[-1].frozen_joints
        elif faults[-1].frozen_joints:
            break
    assert list(faults[-1].frozen_joints) == [NAMES[1]]
    report = faults[-1].joints[1]
    assert report.state == JointFault.LOCKED
    assert report.frozen_position == pytest.approx(held, abs=1e-4)
    assert report.commanded_position == pytest.approx(wanted(time)[1], abs=0.05)
