"""What the re-planner makes of what it is sent: garbage is named, arms come by topic."""

from __future__ import annotations

import math

import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from ft_manip_interfaces.msg import FaultState, RecoveryPlan, TaskGoal
from ft_manip_interfaces.msg import Task as TaskMessage
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.task_file import load_task
from ft_manip_ros.core.urdf_writer import chain_to_urdf
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.conversions import task_to_message
from ft_manip_ros.nodes.replanner import TASK_PLAN
from support.replanned_arm import Rig, fast_arm

pytestmark = pytest.mark.node


def test_garbage_is_named_and_the_node_lives(start_node, probe, tmp_path):
    rig = Rig(start_node, probe, tmp_path)
    states = rig.probe.publisher(JointState, topics.JOINT_STATES, topics.SENSOR_QOS)
    names = list(rig.chain.joint_names)
    for message, complaint in (
        (JointState(name=names, position=[math.nan] * 5), 'NaN'),
        (JointState(name=names, position=[0.0] * 3), 'has 3 values, 5 names'),
        (JointState(name=['wrist'], position=[0.0]), 'joint_1, joint_2'),
    ):
        message.header.stamp = rig.probe.node.get_clock().now().to_msg()
        rig.probe.spin_for(1.1)
        states.publish(message)
        rig.probe.spin_for(0.1)
        rig.node.wait_for(complaint, 5.0)
    bad_goal = TaskGoal()
    bad_goal.pose.position.x = math.nan
    for task, complaint in (
        (TaskMessage(name='empty'), 'no goals'),
        (TaskMessage(name='bad', goals=[bad_goal]), 'three finite numbers'),
    ):
        rig.probe.spin_for(1.1)
        rig.tasks.publish(task)
        rig.node.wait_for(complaint, 5.0)
    for fault, complaint in (
        (FaultState(frozen_joints=['wrist'], frozen_positions=[0.0]), 'wrist'),
        (FaultState(frozen_joints=['joint_1'], frozen_positions=[math.nan]), 'must be finite'),
        (FaultState(frozen_joints=['joint_1']), 'one position each'),
    ):
        rig.probe.spin_for(1.1)
        rig.faults.publish(fault)
        rig.node.wait_for(complaint, 5.0)
    assert not rig.commands
    task = load_task('paredis_eq_11')
    assert rig.send_task(task).status == RecoveryPlan.FINISHES
    rig.reaches(task.goals[0], len(rig.states))


def test_the_arm_may_come_from_the_robot_description(start_node, probe, tmp_path):
    chain = load_arm(fast_arm(tmp_path))
    nodes = [start_node(name, params={'arm': 'topic'}) for name in ('arm_sim', 'replanner')]
    # It comes late, as from a robot_state_publisher that is still starting.
    descriptions = probe.publisher(String, topics.ROBOT_DESCRIPTION, topics.LATCHED_QOS)
    descriptions.publish(String(data=chain_to_urdf(chain)))
    for node in nodes:
        node.wait_for('active', 120.0)
    states = probe.listen(JointState, topics.JOINT_STATES, topics.EVIDENCE_QOS)
    plans = probe.listen(RecoveryPlan, TASK_PLAN, topics.LATCHED_QOS)
    tasks = probe.publisher(TaskMessage, topics.TASK, topics.LATCHED_QOS)
    assert tuple(probe.until(lambda: states, 30.0, 'a joint state')[-1].name) == chain.joint_names
    stamp = probe.node.get_clock().now().nanoseconds
    tasks.publish(task_to_message(load_task('paredis_eq_11'), stamp, 'base'))
    assert probe.until(lambda: plans, 10.0, 'a plan')[-1].status == RecoveryPlan.FINISHES
