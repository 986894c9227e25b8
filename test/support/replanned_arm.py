"""A simulated arm with its re-planner over DDS, and everything that was heard of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from ft_manip_interfaces.msg import FaultState, JointFault, RecoveryPlan
from ft_manip_interfaces.msg import Task as TaskMessage
from ft_manip_interfaces.srv import InjectFault
from ft_manip_ros.core.arm_file import load_arm, load_dh, save_dh
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.conversions import nanoseconds, task_to_message
from ft_manip_ros.nodes.replanner import TASK_PLAN


def fast_arm(folder):
    """Path of a copy of Table 3 with drives fast enough for a test."""
    table = load_dh('paredis_table_3')
    joints = tuple(replace(joint, velocity=3.0, acceleration=12.0) for joint in table.joints)
    path = folder / 'fast.yaml'
    save_dh(replace(table, joints=joints), path)
    return str(path)


class Rig:
    """arm_sim and replanner as processes, and the probe that plays the fault monitor."""

    def __init__(self, start_node, probe, folder, **params):
        self.probe = probe
        self.arm_path = arm_path = fast_arm(folder)
        self.chain = load_arm(arm_path)
        fk(self.chain, np.zeros((1, self.chain.n)))  # compiled now, not while samples go by
        self.sim = start_node('arm_sim', params={'arm': arm_path})
        self.node = start_node('replanner', params={'arm': arm_path, 'dwell': 0.8, **params})
        self.states = probe.listen(JointState, topics.JOINT_STATES, topics.EVIDENCE_QOS)
        self.commands = probe.listen(JointTrajectory, topics.JOINT_TRAJECTORY, topics.COMMAND_QOS)
        self.plans = probe.listen(RecoveryPlan, topics.RECOVERY_PLAN, topics.LATCHED_QOS)
        self.task_plans = probe.listen(RecoveryPlan, TASK_PLAN, topics.LATCHED_QOS)
        self.tasks = probe.publisher(TaskMessage, topics.TASK, topics.LATCHED_QOS)
        self.faults = probe.publisher(FaultState, topics.FAULT_STATE, topics.LATCHED_QOS)
        self.node.wait_for('active', 120.0)
        probe.until(lambda: self.states, 30.0, 'a joint state')

    def send_task(self, task):
        before = len(self.task_plans)
        self.tasks.publish(task_to_message(task, self.now(), 'base'))
        self.probe.until(lambda: len(self.task_plans) > before, 10.0, 'a plan for the task')
        return self.task_plans[-1]

    def now(self):
        return self.probe.node.get_clock().now().nanoseconds

    def position(self):
        return np.array(self.states[-1].position)

    def inject(self, name, kind, at=None):
        """Let a joint fail or work again, ``at`` a time (ns) or now; return where it stands."""
        delay = 0.0 if at is None else max(0.0, (at - self.now()) * 1e-9)
        request = InjectFault.Request(joint=name, kind=kind, delay=delay)
        answer = self.probe.call(InjectFault, topics.INJECT_FAULT, request)
        assert answer.success, answer.message
        # Where it stands is what the joint states say once it does.
        after = nanoseconds(answer.stamp) + 30_000_000
        k = self.chain.index(name)

        def seen():
            late = [s for s in self.states[-200:] if nanoseconds(s.header.stamp) > after]
            return [s.position[k] for s in late] if len(late) > 5 else None

        return float(np.median(self.probe.until(seen, 20.0, 'joint states after the fault')))

    def declare(self, **frozen):
        """Publish what a fault monitor would after these joints locked."""
        message = FaultState(
            frozen_joints=list(frozen),
            frozen_positions=list(frozen.values()),
            joints=[
                JointFault(
                    name=name,
                    state=JointFault.LOCKED,
                    frozen_position=at,
                    frozen_position_sigma=1e-5,
                )
                for name, at in frozen.items()
            ],
        )
        message.header.stamp = self.states[-1].header.stamp
        self.faults.publish(message)

    def plan_after(self, **frozen):
        before = len(self.plans)
        self.declare(**frozen)
        self.probe.until(lambda: len(self.plans) > before, 10.0, 'a plan')
        return self.plans[-1]

    def since(self, plan):
        """Number of the first state after a plan."""
        begin = nanoseconds(plan.trajectory.header.stamp)
        stamps = [nanoseconds(state.header.stamp) for state in self.states]
        return next(k for k, stamp in enumerate(stamps) if stamp >= begin)

    def jump_at_start(self, command):
        """Largest step (rad/s) of a free joint from its measured speed to a command's start.

        NaN where that state was lost on its way to the test, as sensor data may be.
        """
        stamp, first = command.header.stamp, command.points[0]
        state = next((state for state in self.states if state.header.stamp == stamp), None)
        if state is None:
            return math.nan
        points = np.array([point.positions for point in command.points])
        # What an operator declares frozen while it moves stands where it was declared.
        free = np.ptp(points, axis=0) > 0.0
        off = np.abs(np.array(state.position) - first.positions)[free]
        assert off.max(initial=0.0) < 1e-3
        return np.abs(np.array(state.velocity) - first.velocities)[free].max(initial=0.0)

    def reaches(self, goal, since=0, timeout=20.0):
        """Wait until the tool was at a goal in any state from number ``since`` on."""

        def there():
            qs = np.array([state.position for state in self.states[since:]])
            if not len(qs):
                return False
            _, tools = fk(self.chain, qs)
            return np.linalg.norm(tools - goal.position, axis=1).min() < 1e-3

        try:
            self.probe.until(there, timeout, f'the tool at {goal.position}')
        except AssertionError as error:
            raise AssertionError(f'{error}\n{self.node.output}\n{self.sim.output}') from None
