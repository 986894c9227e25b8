"""The fault monitor over DDS: malformed messages of every kind."""

from __future__ import annotations

import math

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ft_manip_interfaces.msg import FaultState, JointFault
from ft_manip_interfaces.srv import ClearFault, FreezeJoint
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.conversions import stamp
from support.monitored_arm import NAMES, motion

pytestmark = pytest.mark.node


def test_garbage_leaves_the_node_alive_and_its_state_held(start_node, probe):
    node = start_node('fault_monitor')
    faults = probe.listen(FaultState, topics.FAULT_STATE, topics.LATCHED_QOS)
    states = probe.publisher(JointState, topics.JOINT_STATES, topics.SENSOR_QOS)
    commands = probe.publisher(JointTrajectory, topics.JOINT_TRAJECTORY, topics.COMMAND_QOS)
    probe.until(lambda: faults, 60.0, 'a fault state')
    time = 1000.0

    def send(names, positions, velocities=(), efforts=()):
        nonlocal time
        time += 0.01
        message = JointState(
            name=names,
            position=[float(q) for q in positions],
            velocity=list(velocities),
            effort=list(efforts),
        )
        message.header.stamp = stamp(round(time * 1e9))
        states.publish(message)
        probe.spin_for(0.01)

    for _ in range(30):
        send(NAMES, [0.1, 0.2, 0.3, 0.4, 0.5])
    freeze = FreezeJoint.Request(joint='joint_5', at_measured=True, reason='brake engaged')
    answer = probe.call(FreezeJoint, topics.FREEZE_JOINT, freeze)
    assert answer.success
    assert answer.position == 0.5
    probe.until(lambda: list(faults[-1].frozen_joints) == ['joint_5'], 10.0, 'the declared lock')

    send(NAMES, [0.1, 0.2, 0.3])
    node.wait_for('joint_states.position: has 3 values for 5 names', 10.0)
    send(['wrist'], [0.0])
    node.wait_for('not joints of this arm, ignored: wrist', 10.0)
    probe.spin_for(1.1)
    send(['joint_1', 'joint_1'], [0.0, 0.0])
    node.wait_for('names a joint twice', 10.0)
    commands.publish(JointTrajectory(joint_names=NAMES, points=[JointTrajectoryPoint()]))
    node.wait_for('has 0 values; 5 joints are named', 10.0)
    probe.spin_for(1.1)
    bad = motion([math.nan] * 5)
    commands.publish(bad)
    node.wait_for('contains NaN', 10.0)
    probe.spin_for(1.1)
    commands.publish(JointTrajectory(joint_names=['wrist'], points=[]))
    node.wait_for('has no watched joint', 10.0)
    send(NAMES, [math.nan, 253.0, 1e184, -math.inf, 0.5])
    probe.until(
        lambda: [joint.state for joint in faults[-1].joints[:4]] == [JointFault.SENSOR] * 4,
        10.0,
        'four sensor faults',
    )
    held = faults[-1].joints
    assert [joint.position for joint in held] == [0.1, 0.2, 0.3, 0.4, 0.5]
    for request, complaint in (
        (FreezeJoint.Request(joint='wrist', at_measured=True), 'joint_1, joint_2'),
        (FreezeJoint.Request(joint='joint_1', position=math.nan), 'finite'),
        (FreezeJoint.Request(joint='joint_1', position=1000.0), 'between -2.61799 and 2.61799'),
    ):
        refused = probe.call(FreezeJoint, topics.FREEZE_JOINT, request)
        assert not refused.success
        assert complaint in refused.message
    unknown = probe.call(ClearFault, topics.CLEAR_FAULT, ClearFault.Request(joint='wrist'))
    assert not unknown.success
    for _ in range(30):
        send(NAMES, [0.1, 0.2, 0.3, 0.4, 0.5])
    probe.until(
        lambda: {joint.state for joint in faults[-1].joints[:4]} <= {JointFault.IDLE},
        10.0,
        'the sensors to be believed again',
    )
    assert list(faults[-1].frozen_joints) == ['joint_5']
    declared = FreezeJoint.Request(joint='joint_4', position=0.75)
    assert probe.call(FreezeJoint, topics.FREEZE_JOINT, declared).position == 0.75
    node.wait_for('joint_4 LOCKED at 0.75: declared frozen: by hand', 10.0)
    assert node.running


def test_a_hail_of_random_messages_leaves_the_node_alive_and_its_faults_held(start_node, probe):
    node = start_node('fault_monitor', params={'reference_topic': 'references'})
    faults = probe.listen(FaultState, topics.FAULT_STATE, topics.LATCHED_QOS)
    states = probe.publisher(JointState, topics.JOINT_STATES, topics.SENSOR_QOS)
    references = probe.publisher(JointState, 'references', topics.SENSOR_QOS)
    commands = probe.publisher(JointTrajectory, topics.JOINT_TRAJECTORY, topics.COMMAND_QOS)
    publishers = (states, references, commands)
    probe.until(
        lambda: faults and all(p.get_subscription_count() for p in publishers), 60.0, 'the node'
    )
    frozen = FreezeJoint.Request(joint='joint_2', position=0.125, reason='by hand')
    assert probe.call(FreezeJoint, topics.FREEZE_JOINT, frozen).success
    rng = np.random.default_rng(11)
    odd = [math.nan, math.inf, -math.inf, 1e308, 253.0, 0.0, -0.5]

    def numbers():
        count = rng.integers(0, 7)
        return [float(rng.choice([*odd, rng.normal()])) for _ in range(count)]

    def names():
        return [str(rng.choice([*NAMES, 'wrist', ''])) for _ in range(rng.integers(0, 7))]

    for k in range(300):
        at = stamp(int(rng.choice([0, 10**18 + k * 10**7, rng.integers(0, 2**61)])))
        if k % 3 < 2:
            message = JointState(
                name=names(), position=numbers(), velocity=numbers(), effort=numbers()
            )
        else:
            points = [
                JointTrajectoryPoint(
                    positions=numbers(),
                    velocities=numbers(),
                    time_from_start=Duration(sec=int(rng.integers(-5, 5))),
                )
                for _ in range(rng.integers(0, 4))
            ]
            message = JointTrajectory(joint_names=names(), points=points)
        message.header.stamp = at
        publishers[k % 3].publish(message)
        probe.spin_for(0.002)
    again = FreezeJoint.Request(joint='joint_5', position=0.5, reason='still listening')
    assert probe.call(FreezeJoint, topics.FREEZE_JOINT, again).success
    probe.until(
        lambda: {'joint_2', 'joint_5'} <= set(faults[-1].frozen_joints), 10.0, 'both locks'
    )
    held = dict(zip(faults[-1].frozen_joints, faults[-1].frozen_positions, strict=True))
    assert (held['joint_2'], held['joint_5']) == (0.125, 0.5)
    assert node.running
