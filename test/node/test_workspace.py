"""The workspace node over DDS: right answers, refused nonsense, batches that block nobody."""

from __future__ import annotations

import json
import math
import shutil
import subprocess

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose, Quaternion
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from ft_manip_interfaces.msg import FtwsAnswer
from ft_manip_interfaces.srv import QueryFtws
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.ftws.map_build import build_map
from ft_manip_ros.core.ftws.map_frame import map_frame
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.nodes import topics

pytestmark = pytest.mark.node

EQ_11 = [(0.5, 0.0, 0.5), (0.0, 0.5, 0.25), (0.75, 0.0, 0.5)]


def pose(x, y, z, w=1.0):
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(w=w))


@pytest.fixture
def ask(start_node, probe):
    """A running workspace node, and a function that asks it."""
    node = start_node('workspace')
    node.wait_for('active')

    def ask(points, **fields):
        request = QueryFtws.Request(poses=[pose(*point) for point in points], **fields)
        return probe.call(QueryFtws, topics.QUERY_FTWS, request)

    ask.node = node
    return ask


def test_the_papers_points_are_members_and_a_far_one_has_a_true_witness(ask, probe):
    markers = probe.listen(MarkerArray, topics.markers('workspace'), topics.LATCHED_QOS)
    response = ask([*EQ_11, (2.2, 0.3, 0.2)], intervals=True)
    assert response.success, response.message
    assert [a.verdict for a in response.answers] == [FtwsAnswer.MEMBER] * 3 + [
        FtwsAnswer.NON_MEMBER
    ]
    arm = load_arm('paredis_table_3')
    assert tuple(response.joint_names) == arm.joint_names
    for answer, point in zip(response.answers, EQ_11, strict=False):
        assert (answer.pose.position.x, answer.pose.position.z) == (point[0], point[2])
        assert list(answer.surviving_fraction) == pytest.approx([1.0] * 5)
        assert sorted(set(answer.tolerated_joints)) == sorted(arm.joint_names)
    lost = response.answers[3]
    # No posture of the named ROD comes closer than the proved distance.
    rod = arm.freeze(dict(zip(lost.joints, lost.angles, strict=True)))
    postures = np.random.default_rng(1).uniform(rod.lower, rod.upper, (20_000, rod.n))
    _, reached = fk(rod, postures)
    assert np.linalg.norm(reached - [2.2, 0.3, 0.2], axis=1).min() >= lost.residual
    probe.until(lambda: markers, 10.0, 'markers')
    assert len(markers[-1].markers[0].points) == 4
    colors = markers[-1].markers[0].colors
    assert colors[0].g > colors[0].r
    assert colors[3].r > colors[3].g


@pytest.fixture(scope='class')
def ask_once(ros_domain):
    """One node for all the requests that it has to survive."""
    from support.probe import Probe
    from support.processes import NodeProcess

    node = NodeProcess([str(shutil.which('ros2')), 'run', 'ft_manip_ros', 'workspace'])
    probe = Probe(ros_domain, 'asker')
    node.wait_for('active')

    def ask(points, **fields):
        request = QueryFtws.Request(poses=[pose(*point) for point in points], **fields)
        return probe.call(QueryFtws, topics.QUERY_FTWS, request)

    yield ask
    assert ask(EQ_11).success
    probe.close()
    node.stop()
    assert not node.clean_up()


class TestOneNodeForAll:
    """Requests that one and the same node survives; it is gone before others start."""

    @pytest.mark.parametrize(
        ('points', 'fields', 'complaint'),
        [
            ([(math.nan, 0.0, 0.0)], {}, 'poses[0].position'),
            ([EQ_11[0], (0.0, math.inf, 0.0)], {}, 'poses[1].position'),
            (EQ_11 * 4_000, {}, 'at most 10000'),
            (EQ_11, {'mode': 'sideways'}, 'position, pose, dextrous'),
            (EQ_11, {'order': 9}, 'order'),
            (EQ_11, {'tolerance': -1.0}, 'tolerance'),
            (EQ_11, {'tolerance': math.nan}, 'tolerance'),
            (EQ_11, {'time_budget': -1.0}, 'time_budget'),
            ([(0.5, 0.0, 0.5, 3.0)], {'mode': 'pose'}, 'poses[0].orientation'),
        ],
    )
    def test_nonsense_is_refused_by_field(self, ask_once, points, fields, complaint):
        response = ask_once(points, **fields)
        assert not response.success
        assert complaint in response.message
        assert not response.answers

    def test_no_points_is_a_fair_question(self, ask_once):
        response = ask_once([])
        assert response.success
        assert not response.answers


def test_a_map_is_shown_if_it_is_of_the_arm(start_node, probe, tmp_path):
    arm = load_arm('planar_4r')
    disc = build_map(arm, map_frame(arm, 'xy'), low=[-2.5, -2.5], high=[2.5, 2.5], depth=4)
    disc.save(tmp_path / 'map.npz')
    clouds = probe.listen(PointCloud2, topics.FTWS_MAP, topics.LATCHED_QOS)
    cubes = probe.listen(MarkerArray, topics.FTWS_MAP_MARKERS, topics.LATCHED_QOS)
    params = {'arm': 'planar_4r', 'map': str(tmp_path / 'map.npz')}
    node = start_node('workspace', params=params)
    node.wait_for('active')
    probe.until(lambda: clouds and cubes, 20.0, 'the map')
    assert clouds[-1].width == int((disc.grid >= 0).sum())
    assert len(cubes[-1].markers[0].points) == int((disc.grid == 1).sum())
    node.stop()
    other = start_node('workspace', params={**params, 'arm': 'planar_5r'})
    other.wait_for("map.npz: is a map of 'planar_4r'")


def test_a_huge_batch_keeps_its_budget_and_blocks_nobody(ask, probe):
    request = QueryFtws.Request(time_budget=3.0)
    request.poses = [pose(0.5 + 1e-6 * i, 0.0, 0.5) for i in range(4_000)]
    client = probe.client(QueryFtws, topics.QUERY_FTWS)
    future = client.call_async(request)
    # Meanwhile the node answers others.
    states = []
    while not future.done():
        answer = probe.call(GetState, 'workspace/get_state', GetState.Request(), timeout=10.0)
        states.append(answer.current_state.id)
    assert states.count(State.PRIMARY_STATE_ACTIVE) >= 5
    response = future.result()
    assert response.success
    assert len(response.answers) == 4_000
    verdicts = [a.verdict for a in response.answers]
    assert verdicts[0] == FtwsAnswer.MEMBER
    assert verdicts[-1] == FtwsAnswer.UNDECIDED
    assert 'budget' in response.answers[-1].reason


def test_deactivation_ends_a_batch_and_a_stop_does_not_wait_for_it(ask, probe):
    request = QueryFtws.Request(time_budget=600.0)
    request.poses = [pose(0.5 + 1e-6 * i, 0.0, 0.5) for i in range(4_000)]
    client = probe.client(QueryFtws, topics.QUERY_FTWS)
    future = client.call_async(request)
    probe.until(lambda: 'judging 4000' in ask.node.output, 20.0, 'the start of the batch')
    change = ChangeState.Request()
    change.transition.id = Transition.TRANSITION_DEACTIVATE
    assert probe.call(ChangeState, 'workspace/change_state', change).success
    probe.until(future.done, 20.0, 'the end of the batch')
    assert future.result().answers[-1].verdict == FtwsAnswer.UNDECIDED
    refused = ask(EQ_11)
    assert not refused.success
    assert 'not active' in refused.message
    change.transition.id = Transition.TRANSITION_ACTIVATE
    assert probe.call(ChangeState, 'workspace/change_state', change).success
    client.call_async(request)
    probe.spin_for(0.3)
    ask.node.stop()


def test_the_command_answers_as_a_person_and_as_json(ask):
    def ftmanip(*arguments):
        command = ['ftmanip', 'query', *arguments]
        return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)

    told = ftmanip('0.5', '0', '0.5', '2.2', '0.3', '0.2')
    assert told.returncode == 0, told.stderr
    assert '(0.5, 0, 0.5)  MEMBER' in told.stdout
    assert 'NOT A MEMBER: lost when joint_' in told.stdout
    rows = ftmanip('--json', '0.5', '0', '0.5', '2.2', '0.3', '0.2').stdout.splitlines()
    assert [json.loads(row)['verdict'] for row in rows] == ['member', 'non_member']
    for bad in (['0.5', '0'], ['0.5', 'nan', '0'], ['--order', '5', '0.5', '0', '0.5']):
        refused = ftmanip(*bad)
        assert refused.returncode == 2
        assert refused.stderr
    assert ftmanip('--namespace', 'elsewhere', '--wait', '1', '0', '0', '0').returncode == 1
