"""The re-planner and the simulated arm over DDS: tasks are finished although joints lock."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from ft_manip_interfaces.msg import FaultState, JointFault, RecoveryPlan, TaskGoal
from ft_manip_interfaces.msg import Task as TaskMessage
from ft_manip_interfaces.srv import ClearFault, FreezeJoint, InjectFault
from ft_manip_ros.core.arm_file import load_arm, load_dh, save_dh
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.task_file import load_task
from ft_manip_ros.core.urdf_writer import chain_to_urdf
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.conversions import nanoseconds, task_to_message
from ft_manip_ros.nodes.replanner import LIMITS, REDUCED, TASK_PLAN

pytestmark = pytest.mark.node


@pytest.fixture(scope='module')
def arm_path(tmp_path_factory):
    """A copy of Table 3 with drives fast enough for a test."""
    table = load_dh('paredis_table_3')
    joints = tuple(replace(joint, velocity=3.0, acceleration=12.0) for joint in table.joints)
    path = tmp_path_factory.mktemp('arm') / 'fast.yaml'
    save_dh(replace(table, joints=joints), path)
    return str(path)


class Rig:
    """arm_sim and replanner as processes, and the probe that plays the fault monitor."""

    def __init__(self, start_node, probe, arm_path, **params):
        self.probe = probe
        self.chain = load_arm(arm_path)
        fk(self.chain, np.zeros((1, self.chain.n)))  # compiled now, not while samples go by
        self.sim = start_node('arm_sim', params={'arm': arm_path})
        self.node = start_node('replanner', params={'arm': arm_path, 'dwell': 0.8, **params})
        self.states = probe.listen(JointState, topics.JOINT_STATES, topics.SENSOR_QOS)
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
        """Largest step (rad/s) of a free joint from its measured speed to a command's start."""
        stamp, first = command.header.stamp, command.points[0]
        state = next(state for state in self.states if state.header.stamp == stamp)
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


@pytest.fixture
def rig(start_node, probe, arm_path):
    return Rig(start_node, probe, arm_path)


def test_each_joint_locks_and_the_task_is_finished(rig):
    task = load_task('paredis_eq_11')
    for name in rig.chain.joint_names:
        plan = rig.send_task(task)
        assert plan.status == RecoveryPlan.FINISHES
        assert not plan.frozen_joints
        # On the way from the first goal to the second.
        start = nanoseconds(plan.trajectory.header.stamp)
        lock_at = start + round((plan.goals[0].arrival + 0.6) * 1e9)
        at = rig.inject(name, InjectFault.Request.LOCK, lock_at)
        since = len(rig.states)
        plan = rig.plan_after(**{name: at})
        assert plan.status == RecoveryPlan.FINISHES, plan.reason
        assert list(plan.frozen_joints) == [name]
        remaining = [goal.index for goal in plan.goals]
        assert 2 in remaining
        assert 0 not in remaining, rig.node.output + rig.sim.output
        assert 0.0 < plan.compute_time < 1.0
        k = rig.chain.index(name)
        points = np.array([point.positions for point in plan.trajectory.points])
        assert np.ptp(points[:, k]) == 0.0
        assert points[0, k] == at
        assert rig.probe.until(lambda: rig.commands, 5.0, 'a command')[-1] == plan.trajectory
        for index in remaining:
            rig.reaches(task.goals[index], since)
        assert abs(rig.position()[k] - at) < 5e-4
        rig.inject(name, InjectFault.Request.RELEASE)
        rig.declare()
        rig.probe.spin_for(0.2)


def test_a_second_failure_is_planned_for_again(rig):
    task = load_task('paredis_eq_11')
    urdfs = rig.probe.listen(String, REDUCED, topics.LATCHED_QOS)
    limit_files = rig.probe.listen(String, LIMITS, topics.LATCHED_QOS)
    rig.send_task(task)
    rig.probe.spin_for(0.3)
    first = rig.inject('joint_1', InjectFault.Request.LOCK)
    plan = rig.plan_after(joint_1=first)
    assert [goal.index for goal in plan.goals] == [0, 1, 2]
    rig.probe.spin_for(0.3)
    second = rig.inject('joint_5', InjectFault.Request.LOCK)
    plan = rig.plan_after(joint_1=first, joint_5=second)
    assert list(plan.frozen_joints) == ['joint_1', 'joint_5']
    points = np.array([point.positions for point in plan.trajectory.points])
    assert np.all(points[:, 0] == first)
    assert np.all(points[:, 4] == second)
    for report in plan.goals:
        assert report.outcome in (report.REACHABLE, report.LOST, report.UNDECIDED)
        if report.outcome == report.REACHABLE:
            rig.reaches(task.goals[report.index])
    # Other planners can go on with the arm that is left.
    reduced = load_arm(rig.probe.until(lambda: urdfs, 5.0, 'a reduced URDF')[-1].data)
    assert reduced.joint_names == ('joint_2', 'joint_3', 'joint_4')
    q = np.array([first, 0.3, -0.2, 0.5, second])
    np.testing.assert_allclose(fk(reduced, q[1:4])[1], fk(rig.chain, q)[1], atol=1e-9)
    limits = yaml.safe_load(limit_files[-1].data)['joint_limits']
    assert limits['joint_5']['min_position'] == limits['joint_5']['max_position'] == second
    # The state did not change: nothing is planned again.
    count = len(rig.plans)
    rig.declare(joint_1=first, joint_5=second)
    rig.probe.spin_for(0.5)
    assert len(rig.plans) == count


def test_policy_halt_stops_the_arm(start_node, probe, arm_path):
    rig = Rig(start_node, probe, arm_path, policy='halt')
    rig.send_task(load_task('paredis_eq_11'))
    rig.probe.spin_for(0.4)
    at = rig.inject('joint_3', InjectFault.Request.LOCK)
    plan = rig.plan_after(joint_3=at)
    assert plan.status == RecoveryPlan.HALTED
    assert 'policy' in plan.reason
    assert all(not goal.positions for goal in plan.goals)
    rig.probe.spin_for(1.0)
    stood = rig.position()
    rig.probe.spin_for(0.5)
    assert np.abs(rig.position() - stood).max() < 5e-4


def test_failure_after_failure_with_the_monitor_itself(start_node, probe, arm_path):
    """Three joints in turn and back, all or nothing; no command starts with a jump."""
    rig = Rig(start_node, probe, arm_path, policy='finish_all_or_halt')
    start_node('fault_monitor', params={'arm': arm_path}).wait_for('active', 120.0)
    task = load_task('paredis_eq_11')
    again = tuple(replace(goal, id=f'{goal.id}_again') for goal in task.goals)
    task = replace(task, goals=task.goals + again)

    def plan_with(*names):
        def made():
            return next((p for p in rig.plans if set(p.frozen_joints) == set(names)), None)

        return rig.probe.until(made, 20.0, f'a plan with {names} frozen')

    start = rig.send_task(task)
    assert start.status == RecoveryPlan.FINISHES
    under_way = nanoseconds(start.trajectory.header.stamp) + 500_000_000
    rig.inject('joint_3', InjectFault.Request.LOCK, under_way)
    first = plan_with('joint_3')
    assert first.status == RecoveryPlan.FINISHES, first.reason
    rig.inject('joint_2', InjectFault.Request.LOCK, rig.now() + 300_000_000)
    second = plan_with('joint_3', 'joint_2')
    # Three joints are left: all of it, or nothing, and then it stands still.
    whole = second.status == RecoveryPlan.FINISHES
    assert whole or (second.status == RecoveryPlan.HALTED and 'all or halt' in second.reason)
    assert all(bool(goal.positions) == whole for goal in second.goals)
    freeze = FreezeJoint.Request(joint='joint_5', at_measured=True, reason='by hand')
    assert rig.probe.call(FreezeJoint, topics.FREEZE_JOINT, freeze).success
    third = plan_with('joint_3', 'joint_2', 'joint_5')
    # Two joints reach a surface at most, and that does not hold all three points.
    assert third.status == RecoveryPlan.HALTED and 'all or halt' in third.reason
    rig.probe.spin_for(1.0)
    stood = rig.position()
    rig.probe.spin_for(0.5)
    assert np.abs(rig.position() - stood).max() < 5e-4
    # Recovered joints count only once they are cleared.
    for name in ('joint_3', 'joint_2'):
        rig.inject(name, InjectFault.Request.RELEASE)
    count = len(rig.task_plans)
    rig.probe.spin_for(0.5)
    assert len(rig.task_plans) == count and rig.plans[-1].status == RecoveryPlan.HALTED
    assert rig.probe.call(ClearFault, topics.CLEAR_FAULT, ClearFault.Request()).success
    rig.probe.until(lambda: len(rig.task_plans) > count, 10.0, 'a plan of the healthy arm')
    healed = rig.task_plans[-1]
    assert healed.status == RecoveryPlan.FINISHES and not healed.frozen_joints
    for report in healed.goals:
        rig.reaches(task.goals[report.index], rig.since(healed))
    # The joints that are free go on as they were measured; one that is frozen by hand while it
    # still moves is held at once.
    for command in rig.commands:
        assert rig.jump_at_start(command) < 1e-9


def test_garbage_is_named_and_the_node_lives(rig):
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


def test_obstacles_are_avoided_or_named(start_node, probe, arm_path, tmp_path):
    around = tmp_path / 'around.yaml'
    # One ball where the third goal is.
    around.write_text('obstacles: [{name: ball, sphere: 0.1, position: [0.75, 0.0, 0.5]}]')
    rig = Rig(
        start_node,
        probe,
        arm_path,
        collision=True,
        link_radius=0.02,
        obstacles=str(around),
    )
    task = load_task('paredis_eq_11')
    np.testing.assert_allclose(task.goals[2].position, [0.75, 0.0, 0.5])
    plan = rig.send_task(task)
    assert plan.status == RecoveryPlan.PARTIAL
    assert plan.goals[2].outcome == plan.goals[2].UNDECIDED
    assert 'ball' in plan.goals[2].reason
    for goal in task.goals[:2]:
        rig.reaches(goal)


def test_among_bodies_the_arm_stops_before_the_plan_is_made(start_node, probe, arm_path):
    rig = Rig(start_node, probe, arm_path, collision=True, link_radius=0.01)
    task = load_task('paredis_eq_11')
    rig.send_task(task)
    k = rig.chain.index('joint_3')
    rig.probe.until(lambda: abs(rig.states[-1].velocity[k]) > 0.2, 10.0, 'joint_3 to move')
    at = rig.inject('joint_3', InjectFault.Request.LOCK)
    before = len(rig.commands)
    plan = rig.plan_after(joint_3=at)
    rig.probe.until(lambda: len(rig.commands) >= before + 2, 5.0, 'the stop and the plan')
    stop, whole = rig.commands[before : before + 2]
    assert stop.header.stamp == whole.header.stamp == plan.trajectory.header.stamp
    assert whole == plan.trajectory
    # The plan goes on where the stop ends.
    assert np.abs(stop.points[-1].velocities).max() == 0.0
    braking = [p for p in stop.points if np.abs(p.velocities).max() > 0.0]
    assert braking == whole.points[: len(braking)]
    assert all(point.positions[k] == at for point in [*stop.points, *whole.points])
    promised = [goal for goal in plan.goals if goal.positions]
    assert promised
    since = rig.since(plan)
    for report in promised:
        rig.reaches(task.goals[report.index], since)


def test_an_arm_without_bodies_is_refused_by_name(start_node):
    node = start_node('replanner', params={'collision': True})
    node.wait_for('link_radius', 60.0)
    assert node.running


def test_the_arm_may_come_from_the_robot_description(start_node, probe, arm_path):
    chain = load_arm(arm_path)
    nodes = [start_node(name, params={'arm': 'topic'}) for name in ('arm_sim', 'replanner')]
    # It comes late, as from a robot_state_publisher that is still starting.
    descriptions = probe.publisher(String, topics.ROBOT_DESCRIPTION, topics.LATCHED_QOS)
    descriptions.publish(String(data=chain_to_urdf(chain)))
    for node in nodes:
        node.wait_for('active', 120.0)
    states = probe.listen(JointState, topics.JOINT_STATES, topics.SENSOR_QOS)
    plans = probe.listen(RecoveryPlan, TASK_PLAN, topics.LATCHED_QOS)
    tasks = probe.publisher(TaskMessage, topics.TASK, topics.LATCHED_QOS)
    assert tuple(probe.until(lambda: states, 30.0, 'a joint state')[-1].name) == chain.joint_names
    stamp = probe.node.get_clock().now().nanoseconds
    tasks.publish(task_to_message(load_task('paredis_eq_11'), stamp, 'base'))
    assert probe.until(lambda: plans, 10.0, 'a plan')[-1].status == RecoveryPlan.FINISHES
