"""The re-planner over DDS among bodies: they are avoided or named, and the arm stops first."""

from __future__ import annotations

import numpy as np
import pytest

from ft_manip_interfaces.msg import RecoveryPlan
from ft_manip_interfaces.srv import InjectFault
from ft_manip_ros.core.task_file import load_task
from support.replanned_arm import Rig

pytestmark = pytest.mark.node


def test_obstacles_are_avoided_or_named(start_node, probe, tmp_path):
    around = tmp_path / 'around.yaml'
    # One ball where the third goal is.
    around.write_text('obstacles: [{name: ball, sphere: 0.1, position: [0.75, 0.0, 0.5]}]')
    rig = Rig(
        start_node,
        probe,
        tmp_path,
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


def test_among_bodies_the_arm_stops_before_the_plan_is_made(start_node, probe, tmp_path):
    rig = Rig(start_node, probe, tmp_path, collision=True, link_radius=0.01)
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
