"""The fault monitor over DDS, on the simulated arm: locks, false alarms, losses, restarts."""

from __future__ import annotations

import json
import os
import signal

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import JointState
from visualization_msgs.msg import Marker, MarkerArray

from ft_manip_interfaces.msg import CommandHeard, FaultState, JointFault, RecoveryPlan
from ft_manip_interfaces.srv import ClearFault, FreezeJoint, InjectFault
from ft_manip_ros.core.detection.settings import MonitorSettings
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.conversions import seconds
from support.monitored_arm import NAMES, Scene, motion

pytestmark = pytest.mark.node

HEALTHY = (JointFault.OK, JointFault.IDLE, JointFault.SUSPECT)


def worst(events):
    return {event.state for event in events} - set(HEALTHY)


def test_each_joint_locked_in_turn_released_cleared_and_proved(start_node, probe):
    scene = Scene(start_node, probe)
    side = 1.0
    scene.move([0.3 * side] * 5)
    probe.spin_for(2.5)
    assert not worst(scene.events)
    for joint in NAMES:
        del scene.events[:]
        side = -side
        scene.move([0.3 * side] * 5)
        answer = scene.inject(joint, InjectFault.Request.LOCK, 0.7)
        scene.await_frozen([joint], f'{joint} to be found')
        locks = probe.until(
            lambda: [event for event in scene.events if event.state == JointFault.LOCKED],
            10.0,
            'the event',
        )
        (lock,) = locks
        locked_at = seconds(answer.stamp)
        delay = seconds(lock.stamp) - locked_at
        assert lock.name == joint
        assert not lock.manual
        assert 0.0 < delay < 0.6
        assert seconds(lock.confirmed) == seconds(lock.stamp)
        assert locked_at - 0.011 <= seconds(lock.first_evidence) <= seconds(lock.stamp)
        # Only what was measured since the lock tells where the joint stands.
        readings = probe.until(
            lambda j=joint, at=locked_at: scene.readings(j, at), 10.0, 'ten samples of it'
        )
        stands = np.mean(readings)
        # What moves less than this within a sample stands still.
        still = MonitorSettings().still_revolute + 4.0 * lock.frozen_position_sigma
        assert scene.faults[-1].frozen_positions[0] == pytest.approx(stands, abs=still)
        assert 0.0 < lock.frozen_position_sigma < 1e-4
        # Back where it stands, so that nothing leaps when it is released.
        here = list(scene.states[-1].position)
        scene.move(here, 0.5)
        probe.spin_for(0.8)
        scene.inject(joint, InjectFault.Request.RELEASE)
        cleared = probe.call(ClearFault, topics.CLEAR_FAULT, ClearFault.Request(joint=joint))
        assert cleared.success
        assert list(cleared.cleared) == [joint]
        index = NAMES.index(joint)
        scene.await_frozen([], f'{joint} to be cleared')
        assert scene.faults[-1].joints[index].state == JointFault.PROVING
        scene.move([0.3 * side] * 5, 1.5)
        probe.until(
            lambda i=index: scene.faults[-1].joints[i].state == JointFault.OK,
            10.0,
            f'{joint} to prove itself',
        )
        probe.spin_for(2.0)
        assert worst(scene.events) <= {JointFault.LOCKED, JointFault.PROVING}


@pytest.mark.parametrize('loss', [0.0, 0.02])
def test_no_alarm_without_a_failure_and_a_lock_found_all_the_same(start_node, probe, loss):
    sim = {'drop_fraction': loss, 'reorder_fraction': loss, 'seed': 3}
    scene = Scene(start_node, probe, sim=sim)
    rng = np.random.default_rng(7)
    for _ in range(6):
        # Some joints rest while others move, slowly or fast, and the arm pauses in between.
        target = rng.uniform(-0.5, 0.5, 5) * (rng.random(5) < 0.7)
        time = rng.uniform(1.2, 2.5)
        scene.move(target, time)
        probe.spin_for(time + rng.choice([0.0, 0.6]))
    assert not worst(scene.events)
    assert len(scene.states) > 300
    scene.move([0.6] * 5, 2.0)
    scene.inject('joint_2', InjectFault.Request.LOCK, 0.6)
    scene.await_frozen(['joint_2'], 'the lock')


def test_what_waited_while_the_node_stood_still_is_evidence_all_the_same(start_node, probe):
    scene = Scene(start_node, probe)
    scene.move([0.3] * 5)
    probe.spin_for(2.5)
    # It goes on when the node does: the lock is found, late or on time.
    scene.move([-0.9] * 5, 6.0)
    probe.spin_for(0.7)
    os.kill(scene.node.pid, signal.SIGSTOP)
    try:
        answer = scene.inject('joint_2', InjectFault.Request.LOCK)
        probe.spin_for(1.0)
    finally:
        os.kill(scene.node.pid, signal.SIGCONT)
    scene.await_frozen(['joint_2'], 'the lock')
    (lock,) = probe.until(
        lambda: [event for event in scene.events if event.state == JointFault.LOCKED],
        10.0,
        'the event',
    )
    # Judged by samples of the time when it stood still, not by those that came afterwards.
    assert 0.0 < seconds(lock.stamp) - seconds(answer.stamp) < 0.6


def test_a_lock_at_rest_is_found_when_the_joint_is_commanded(start_node, probe):
    scene = Scene(start_node, probe)
    scene.move([0.3] * 5)
    probe.spin_for(2.5)
    scene.inject('joint_4', InjectFault.Request.LOCK)
    scene.move([0.0, 0.0, 0.0, 0.3, 0.0])
    probe.spin_for(3.0)
    assert not worst(scene.events)
    scene.move([0.2] * 5)
    scene.await_frozen(['joint_4'], 'the lock')
    assert scene.faults[-1].frozen_positions[0] == pytest.approx(0.3, abs=1e-3)


def test_a_motion_commanded_before_it_listened_is_known_from_the_plan(start_node, probe):
    report = RecoveryPlan(trajectory=motion([0.5] * 5, 600.0))
    # As plans have it: the first point is where the arm stands.
    report.trajectory.points[:0] = motion([0.0] * 5, 0.0).points
    report.trajectory.header.stamp = probe.node.get_clock().now().to_msg()
    plans = probe.node.create_publisher(RecoveryPlan, topics.TASK_PLAN, topics.LATCHED_QOS)
    plans.publish(report)
    start_node('fault_monitor').wait_for('active', 120.0)
    faults = probe.listen(FaultState, topics.FAULT_STATE, topics.LATCHED_QOS)
    heard = probe.listen(CommandHeard, topics.COMMANDS_HEARD, topics.TRAJECTORY_QOS)
    states = probe.publisher(JointState, topics.JOINT_STATES, topics.SENSOR_QOS)

    def commanded():
        state = JointState(name=NAMES, position=[0.0] * 5)
        state.header.stamp = probe.node.get_clock().now().to_msg()
        states.publish(state)
        # Whatever the monitor makes of so slow a motion, a declared joint is published at once.
        count = len(faults)
        freeze = FreezeJoint.Request(joint='joint_5', position=0.0)
        assert probe.call(FreezeJoint, topics.FREEZE_JOINT, freeze).success
        probe.until(lambda: len(faults) > count, 10.0, 'the state with the declared joint')
        return all(0.0 <= joint.commanded_position < 0.5 for joint in faults[-1].joints)

    probe.until(commanded, 30.0, 'the command to be known')
    probe.until(lambda: heard, 10.0, 'that the command was taken')
    assert [message.start for message in heard] == [report.trajectory.header.stamp]
    probe.node.destroy_publisher(plans)


def test_faults_survive_a_restart_and_are_shown(start_node, probe, tmp_path):
    path = tmp_path / 'state' / 'faults.json'
    node = start_node('fault_monitor', params={'state_file': str(path)})
    request = FreezeJoint.Request(joint='joint_3', position=0.25, reason='seen by a person')
    assert probe.call(FreezeJoint, topics.FREEZE_JOINT, request).success
    probe.until(path.exists, 10.0, 'the state file')
    assert json.loads(path.read_text())['faults'][0]['joint'] == 'joint_3'
    node.stop()

    start_node('fault_monitor', params={'state_file': str(path)})
    faults = probe.listen(FaultState, topics.FAULT_STATE, topics.LATCHED_QOS)
    diagnostics = probe.listen(DiagnosticArray, topics.DIAGNOSTICS, topics.COMMAND_QOS)
    markers = probe.listen(MarkerArray, topics.markers('fault_monitor'), topics.LATCHED_QOS)
    probe.until(lambda: faults and diagnostics and markers, 60.0, 'the restarted monitor')
    assert list(faults[-1].frozen_joints) == ['joint_3']
    assert list(faults[-1].frozen_positions) == [0.25]
    report = faults[-1].joints[2]
    assert report.manual
    assert 'seen by a person' in report.cause
    status = {entry.name: entry for entry in diagnostics[-1].status}
    assert set(status) == {f'fault_monitor: {name}' for name in ['fault_monitor', *NAMES]}
    assert status['fault_monitor: joint_3'].level == DiagnosticStatus.ERROR
    assert status['fault_monitor: joint_1'].level == DiagnosticStatus.STALE
    summary = {pair.key: pair.value for pair in status['fault_monitor: fault_monitor'].values}
    assert summary == {'missed joint states': '0'}
    assert {entry.hardware_id for entry in diagnostics[-1].status} == {'paredis_table_3'}
    shown = [marker for marker in markers[-1].markers if marker.action == Marker.ADD]
    assert {marker.ns for marker in shown} == {'joint_3'}
    cleared = probe.call(ClearFault, topics.CLEAR_FAULT, ClearFault.Request())
    assert list(cleared.cleared) == ['joint_3']
    assert json.loads(path.read_text())['faults'] == []


def test_a_damaged_state_file_is_not_passed_over(start_node, tmp_path):
    path = tmp_path / 'faults.json'
    path.write_text('{"version": 1, "faults": [{"joint"')
    node = start_node('fault_monitor', params={'state_file': str(path)})
    node.wait_for('is no state file of a fault monitor')
    assert node.running
