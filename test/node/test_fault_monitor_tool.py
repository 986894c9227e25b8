"""The fault monitor with poses of the tool, over DDS, on the simulated arm."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped

from ft_manip_interfaces.msg import JointFault
from ft_manip_interfaces.srv import ClearFault, InjectFault
from ft_manip_ros.nodes import topics
from support.monitored_arm import Scene

pytestmark = pytest.mark.node


def found(scene):
    return lambda: [e for e in scene.events if e.state in (JointFault.SENSOR, JointFault.LOCKED)]


def test_a_stuck_encoder_is_told_from_a_lock_by_the_tool(start_node, probe):
    scene = Scene(
        start_node,
        probe,
        sim={'tool_pose_rate': 50.0, 'seed': 4},
        monitor={'tool_pose_topic': topics.TOOL_POSE},
    )
    diagnostics = probe.listen(DiagnosticArray, topics.DIAGNOSTICS, topics.COMMAND_QOS)
    # A pose in another frame is complained of, and does no harm.
    poses = probe.publisher(PoseStamped, topics.TOOL_POSE, topics.SENSOR_QOS)
    foreign = PoseStamped()
    foreign.header.frame_id = 'camera'
    poses.publish(foreign)
    scene.node.wait_for("frame_id: is 'camera'", 20.0)

    def learned():
        told = [value.value for status in diagnostics[-1:] for value in status.status[0].values]
        return any('moves with the arm' in text for text in told)

    side = 1.0
    for _ in range(20):
        scene.move([0.5 * side] * 5, 1.5)
        side = -side
        probe.spin_for(1.6)
        if learned():
            break
    probe.until(learned, 10.0, 'the tool to be seen to move with the arm')
    for _ in range(4):
        del scene.events[:]
        scene.move([0.6 * side] * 5, 4.0)
        scene.inject('joint_2', InjectFault.Request.STUCK_ENCODER, 1.5)
        event = probe.until(found(scene), 15.0, 'the stuck encoder')[0]
        assert event.name == 'joint_2'
        if event.state == JointFault.SENSOR:
            assert 'the joint moves' in event.cause
            return
        # A monitor that is starved of poses calls it a lock, as without them: once more.
        side = -side
        scene.inject('joint_2', InjectFault.Request.RELEASE)
        scene.move([0.6 * side] * 5, 4.0)
        probe.call(ClearFault, topics.CLEAR_FAULT, ClearFault.Request())
        probe.spin_for(5.0)
    pytest.fail('a stuck encoder was LOCKED four times')
