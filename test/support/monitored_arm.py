"""A monitored simulated arm over DDS, and everything that was heard of it."""

from __future__ import annotations

import math

from builtin_interfaces.msg import Duration
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ft_manip_interfaces.msg import FaultState, JointFault
from ft_manip_interfaces.srv import FreezeJoint, InjectFault
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.conversions import seconds

NAMES = list(load_arm('paredis_table_3').joint_names)


def motion(target, time=2.0):
    point = JointTrajectoryPoint(
        positions=[float(x) for x in target],
        velocities=[0.0] * len(target),
        time_from_start=Duration(sec=int(time), nanosec=round((time % 1.0) * 1e9)),
    )
    return JointTrajectory(joint_names=NAMES, points=[point])


class Scene:
    """A monitored arm and everything that was heard of it."""

    def __init__(self, start_node, probe, sim=None, monitor=None):
        self.probe = probe
        self.node = start_node('fault_monitor', params=monitor)
        self.sim = start_node('arm_sim', params=sim)
        self.states = probe.listen(JointState, topics.JOINT_STATES, topics.EVIDENCE_QOS)
        self.faults = probe.listen(FaultState, topics.FAULT_STATE, topics.LATCHED_QOS)
        self.events = probe.listen(JointFault, topics.FAULT_EVENTS, topics.EVENT_QOS)
        self.commands = probe.publisher(
            JointTrajectory, topics.JOINT_TRAJECTORY, topics.COMMAND_QOS
        )
        probe.until(
            lambda: self.commands.get_subscription_count() == 2, 60.0, 'both to hear commands'
        )
        probe.until(
            lambda: self.states and self.faults and probe.node.count_publishers('fault_events'),
            60.0,
            'joint and fault states',
        )
        # A state per change is published once joint states arrive.
        probe.until(
            lambda: all(not math.isnan(q) for q in self.positions()), 30.0, 'the joints to be seen'
        )

    def positions(self):
        answers = self.probe.call(FreezeJoint, topics.FREEZE_JOINT, FreezeJoint.Request(joint='?'))
        assert not answers.success
        return self.states[-1].position

    def inject(self, joint, kind, delay=0.0):
        request = InjectFault.Request(joint=joint, kind=kind, delay=delay)
        answer = self.probe.call(InjectFault, topics.INJECT_FAULT, request)
        assert answer.success, answer.message
        return answer

    def move(self, target, time=2.0):
        self.commands.publish(motion(target, time))

    def readings(self, joint, since):
        """Positions with stamps after ``since`` (s), once there are ten."""
        index = NAMES.index(joint)
        out = [s.position[index] for s in self.states if seconds(s.header.stamp) > since]
        return out if len(out) >= 10 else []

    def frozen(self):
        return list(self.faults[-1].frozen_joints)

    def await_frozen(self, joints, what):
        self.probe.until(lambda: self.frozen() == joints, 15.0, what)
