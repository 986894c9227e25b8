"""The re-planner and the simulated arm over DDS: tasks are finished although joints lock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml
from std_msgs.msg import String

from ft_manip_interfaces.msg import RecoveryPlan
from ft_manip_interfaces.srv import ClearFault, FreezeJoint, InjectFault
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.task_file import load_task
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.conversions import nanoseconds
from ft_manip_ros.nodes.replanner import LIMITS, REDUCED
from support.replanned_arm import Rig

pytestmark = pytest.mark.node


def test_each_joint_locks_and_the_task_is_finished(start_node, probe, tmp_path):
    rig = Rig(start_node, probe, tmp_path)
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


def test_a_second_failure_is_planned_for_again(start_node, probe, tmp_path):
    rig = Rig(start_node, probe, tmp_path)
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


def test_policy_halt_stops_the_arm(start_node, probe, tmp_path):
    rig = Rig(start_node, probe, tmp_path, policy='halt')
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


def test_failure_after_failure_with_the_monitor_itself(start_node, probe, tmp_path):
    """Three joints in turn and back, all or nothing; no command starts with a jump."""
    rig = Rig(start_node, probe, tmp_path, policy='finish_all_or_halt')
    start_node('fault_monitor', params={'arm': rig.arm_path}).wait_for('active', 120.0)
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
    jumps = [rig.jump_at_start(command) for command in rig.commands]
    assert np.nanmax(jumps) < 1e-9
    assert np.isfinite(jumps).mean() > 0.5
