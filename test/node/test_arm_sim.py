"""The simulated arm over DDS: moves, reports, fails on request, and survives garbage."""

from __future__ import annotations

import math

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ft_manip_interfaces.srv import InjectFault
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.conversions import seconds

pytestmark = pytest.mark.node

NAMES = list(load_arm('paredis_table_3').joint_names)


def point(positions, time, velocities=()):
    whole = int(time)
    return JointTrajectoryPoint(
        positions=[float(x) for x in positions],
        velocities=[float(x) for x in velocities],
        time_from_start=Duration(sec=whole, nanosec=round((time - whole) * 1e9)),
    )


def trajectory(*points, names=NAMES):
    return JointTrajectory(joint_names=list(names), points=list(points))


def now_at(states):
    return np.array(states[-1].position)


@pytest.fixture
def arm(start_node, probe):
    """A running arm_sim, what it reports, and a publisher that it listens to."""
    node = start_node('arm_sim')
    states = probe.listen(JointState, topics.JOINT_STATES, topics.EVIDENCE_QOS)
    commands = probe.publisher(JointTrajectory, topics.JOINT_TRAJECTORY, topics.COMMAND_QOS)
    probe.until(lambda: states, 20.0, 'a joint state')
    return node, states, commands


def test_moves_reports_locks_and_releases(arm, probe):
    _, states, commands = arm
    assert list(states[-1].name) == NAMES
    assert np.abs(now_at(states)).max() < 1e-3
    target = [0.3, -0.2, 0.25, 0.1, -0.3]
    commands.publish(trajectory(point(target, 1.0)))
    reached = lambda q: lambda: np.abs(now_at(states) - q).max() < 5e-4  # noqa: E731
    probe.until(reached(np.array(target)), 10.0, 'the arm at its target')

    request = InjectFault.Request(joint=NAMES[1], kind=InjectFault.Request.LOCK, delay=0.3)
    answer = probe.call(InjectFault, topics.INJECT_FAULT, request)
    assert answer.success, answer.message
    assert answer.position == pytest.approx(-0.2, abs=6e-4)
    commands.publish(trajectory(point([0.0] * 5, 1.0)))
    others = [0, 2, 3, 4]
    probe.until(
        lambda: np.abs(now_at(states)[others]).max() < 5e-4, 10.0, 'the healthy joints at 0'
    )
    stuck = now_at(states)[1]
    assert -0.2 <= stuck < -0.05
    locked_at = seconds(answer.stamp)
    stood = lambda: [s.position[1] for s in states if seconds(s.header.stamp) > locked_at]  # noqa: E731
    probe.until(lambda: len(stood()) > 50, 10.0, 'fifty states since the lock')
    assert np.ptp(stood()) < 4e-4

    request.kind = InjectFault.Request.RELEASE
    request.delay = 0.0
    assert probe.call(InjectFault, topics.INJECT_FAULT, request).success
    probe.until(reached(np.zeros(5)), 10.0, 'the released joint at 0')


GARBAGE = {
    'has no points': trajectory(),
    'have lengths': trajectory(point([0.1, 0.2], 1.0)),
    'contains NaN': trajectory(point([math.nan] * 5, 1.0)),
    'each once': trajectory(point([0.1] * 5, 1.0), names=[*NAMES[:4], 'wrist']),
    'must start at 0 or later and grow': trajectory(point([0.1] * 5, 1.0), point([0.2] * 5, 1.0)),
    'outside [-2.61799, 2.61799]': trajectory(point([0.0, 9.0, 0.0, 0.0, 0.0], 1.0)),
    'velocities: have lengths [0, 5]': trajectory(
        point([0.1] * 5, 1.0, [0.0] * 5), point([0.2] * 5, 2.0)
    ),
}


def test_garbage_is_refused_by_name_and_the_arm_holds(arm, probe):
    node, states, commands = arm
    for complaint, message in GARBAGE.items():
        for _ in range(10):
            commands.publish(message)
            # One line a second for each source.
            probe.spin_for(1.1)
            if complaint in node.output:
                break
        node.wait_for(complaint, 5.0)
    assert np.abs(now_at(states)).max() < 1e-3
    for joint, kind, delay, complaint in (
        ('wrist', 0, 0.0, 'joint_1, joint_2'),
        (NAMES[0], 7, 0.0, 'kind'),
        (NAMES[0], 0, math.nan, 'delay'),
        (NAMES[0], 0, -1.0, 'delay'),
        (NAMES[0], 2, 0.0, 'lag'),
    ):
        request = InjectFault.Request(joint=joint, kind=kind, delay=delay)
        answer = probe.call(InjectFault, topics.INJECT_FAULT, request)
        assert not answer.success
        assert complaint in answer.message
    count = len(states)
    probe.until(lambda: len(states) > count + 20, 5.0, 'more joint states')
    commands.publish(trajectory(point([0.1] * 5, 0.5)))
    probe.until(lambda: np.abs(now_at(states) - 0.1).max() < 5e-4, 10.0, 'a good motion after')


def test_losses_and_reordering_are_as_asked(start_node, probe):
    params = {'rate': 200.0, 'drop_fraction': 0.3, 'reorder_fraction': 0.2, 'seed': 5}
    start_node('arm_sim', params=params)
    states = probe.listen(JointState, topics.JOINT_STATES, topics.EVIDENCE_QOS)
    probe.until(lambda: len(states) >= 300, 30.0, '300 joint states')
    stamps = np.array([s.header.stamp.sec + 1e-9 * s.header.stamp.nanosec for s in states])
    backwards = np.mean(np.diff(stamps) < 0.0)
    share = len(stamps) / ((stamps.max() - stamps.min()) * 200.0)
    assert 0.08 < backwards < 0.25
    assert 0.5 < share < 0.85
