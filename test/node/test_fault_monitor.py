"""The fault monitor over DDS, on the simulated arm: locks, false alarms, losses, garbage."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from visualization_msgs.msg import Marker, MarkerArray

from ft_manip_interfaces.msg import FaultState, JointFault, RecoveryPlan
from ft_manip_interfaces.srv import ClearFault, FreezeJoint, InjectFault
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.detection.settings import MonitorSettings
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.conversions import seconds, stamp
from ft_manip_ros.nodes.fault_messages import desired_positions

pytestmark = pytest.mark.node

NAMES = list(load_arm('paredis_table_3').joint_names)
HEALTHY = (JointFault.OK, JointFault.IDLE, JointFault.SUSPECT)


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
        self.states = probe.listen(JointState, topics.JOINT_STATES, topics.SENSOR_QOS)
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


@pytest.mark.parametrize(
    ('fields', 'wanted'),
    [
        ({'reference': [1.0, 2.0]}, [1.0, 2.0]),
        ({'desired': [3.0]}, [3.0]),
        ({'reference': [], 'desired': [4.0]}, [4.0]),
        ({'reference': []}, []),
    ],
)
def test_desired_fields_of_a_controller_state_are_read_under_either_name(fields, wanted):
    points = {name: JointTrajectoryPoint(positions=values) for name, values in fields.items()}
    assert desired_positions(SimpleNamespace(**points)) == wanted


def test_a_motion_commanded_before_it_listened_is_known_from_the_plan(start_node, probe):
    report = RecoveryPlan(trajectory=motion([0.5] * 5, 600.0))
    report.trajectory.header.stamp = probe.node.get_clock().now().to_msg()
    plans = probe.node.create_publisher(RecoveryPlan, topics.TASK_PLAN, topics.LATCHED_QOS)
    plans.publish(report)
    start_node('fault_monitor')
    faults = probe.listen(FaultState, topics.FAULT_STATE, topics.LATCHED_QOS)
    states = probe.publisher(JointState, topics.JOINT_STATES, topics.SENSOR_QOS)

    def commanded():
        state = JointState(name=NAMES, position=[0.0] * 5)
        state.header.stamp = probe.node.get_clock().now().to_msg()
        states.publish(state)
        answer = probe.call(FreezeJoint, topics.FREEZE_JOINT, FreezeJoint.Request(joint='?'))
        assert not answer.success
        known = [joint.commanded_position for joint in faults[-1].joints] if faults else []
        return known and all(0.0 <= value < 0.5 for value in known)

    probe.until(commanded, 30.0, 'the command to be known')
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
