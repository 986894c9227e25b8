"""The designer as a process: the default task, the action with feedback and cancel, bad goals."""

from __future__ import annotations

import math
import signal
import time

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from ft_manip_interfaces.action import DesignArm
from ft_manip_interfaces.msg import DesignCandidate, TaskRegion
from ft_manip_interfaces.msg import Task as TaskMessage
from ft_manip_ros.core.ftws.certificate import load_certificate, verify
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.task_file import load_task
from ft_manip_ros.core.urdf import chain_from_urdf
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.conversions import task_to_message
from support.dense_reach import dh_frame

pytestmark = pytest.mark.node

TASK = load_task('paredis_eq_11')


class Client:
    """An action client driven by the probe."""

    def __init__(self, probe):
        self.probe = probe
        self.feedback = []
        self.client = ActionClient(probe.node, DesignArm, topics.DESIGN_ARM)
        probe.until(self.client.server_is_ready, 60.0, 'the action')

    def send(self, goal):
        future = self.client.send_goal_async(goal, self._on_feedback)
        self.probe.until(future.done, 30.0, 'the answer to the goal')
        return future.result()

    def result(self, handle, timeout=60.0):
        future = handle.get_result_async()
        self.probe.until(future.done, timeout, 'the result')
        return future.result()

    def _on_feedback(self, message):
        self.feedback.append(message.feedback)


def start_idle(start_node, **params):
    node = start_node('designer', params={'run_at_start': False, **params})
    node.wait_for(': active')
    return node


@pytest.fixture
def client(probe):
    made = []

    def make():
        made.append(Client(probe))
        return made[-1]

    yield make
    for one in made:
        one.client.destroy()


def action_goal(**fields):
    values = {
        'task': task_to_message(TASK, 0, 'base_link'),
        'dof': 5,
        'lower': -math.radians(150),
        'upper': math.radians(150),
        **fields,
    }
    return DesignArm.Goal(**values)


# With one of three joints locked, the other two cannot reach points in space.
def hopeless(**fields):
    return action_goal(dof=3, time_budget=60.0, **fields)


def test_it_designs_for_its_default_task_at_once(start_node, probe):
    candidates = probe.listen(DesignCandidate, topics.DESIGN_CANDIDATES, topics.HISTORY_QOS)
    best = probe.listen(DesignCandidate, topics.DESIGN_BEST, topics.LATCHED_QOS)
    final = probe.listen(DesignCandidate, topics.DESIGN_FINAL, topics.LATCHED_QOS)
    urdf = probe.listen(String, topics.ROBOT_DESCRIPTION, topics.LATCHED_QOS)
    markers = probe.listen(MarkerArray, topics.markers('designer'), topics.LATCHED_QOS)
    start_node('designer')
    probe.until(lambda: final and urdf and markers, 90.0, 'the final design')
    answer = final[0]
    assert answer.status == DesignCandidate.FINAL_PROVED, answer.reason
    assert answer.task == 'paredis_eq_11'
    assert answer.penalty == 0.0
    assert len(answer.goal_penalties) == 3
    assert answer.header.frame_id == 'base_link'
    assert best[-1].penalty == 0.0
    assert best[-1].design.d == answer.design.d
    assert candidates
    # The arm at every goal, from the base to the goal.
    lines = [marker for marker in markers[0].markers if marker.ns == 'arm']
    assert len(lines) == 3
    for line, goal in zip(lines, TASK.goals, strict=True):
        tip = line.points[-1]
        np.testing.assert_allclose([tip.x, tip.y, tip.z], goal.position, atol=1e-5)
    # The tool's way from the first goal to the last.
    (way,) = [marker for marker in markers[0].markers if marker.ns == 'tool_path']
    for end, goal in ((way.points[0], TASK.goals[0]), (way.points[-1], TASK.goals[-1])):
        np.testing.assert_allclose([end.x, end.y, end.z], goal.position, atol=1e-5)
    # The URDF is the same arm.
    chain = chain_from_urdf(urdf[0].data)
    rng = np.random.default_rng(0)
    for q in rng.uniform(-2, 2, (10, 5)):
        design = answer.design
        expected = dh_frame(design.d, design.a, design.alpha, q)
        np.testing.assert_allclose(fk(chain, q)[1], expected[:3, 3], atol=1e-9)


def test_an_action_goal_with_a_volume_is_worked_on(start_node, client):
    start_idle(start_node, workers=1)
    actor = client()
    bin_ = TaskRegion(shape=TaskRegion.SPHERE, radius=0.01)
    bin_.goal.pose.position.x, bin_.goal.pose.position.z = 0.4, 0.3
    limits = [-2.4, 2.4, *[-2.6, 2.6] * 4]
    goal = action_goal(seed=4, regions=[bin_], joint_limits=limits, time_budget=120.0)
    handle = actor.send(goal)
    assert handle.accepted
    answer = actor.result(handle, 130.0)
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert answer.result.proved, answer.result.reason
    assert answer.result.candidate.status == DesignCandidate.FINAL_PROVED
    assert answer.result.candidate.seed == 4
    assert list(answer.result.candidate.design.lower) == limits[::2]
    assert '1 whole regions' in answer.result.reason
    assert answer.result.urdf.startswith('<')
    assert answer.result.elapsed > 0.0


def test_cancel_returns_the_best_so_far(start_node, client):
    start_idle(start_node)
    actor = client()
    handle = actor.send(hopeless())
    assert handle.accepted
    second = actor.send(hopeless())
    assert not second.accepted
    actor.probe.until(lambda: len(actor.feedback) > 4, 60.0, 'feedback')
    latest = actor.feedback[-1]
    assert 0.0 < latest.elapsed < 60.0
    assert 0.0 < latest.remaining < 60.0
    assert 0.0 <= latest.eta <= latest.remaining
    cancel = handle.cancel_goal_async()
    actor.probe.until(cancel.done, 10.0, 'the answer to the cancel')
    answer = actor.result(handle, 10.0)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert not answer.result.proved
    assert 'request' in answer.result.reason
    candidate = answer.result.candidate
    assert candidate.status == DesignCandidate.FINAL_UNPROVED
    assert len(candidate.design.d) == 3
    assert 0.0 < candidate.penalty < math.inf


def test_bad_goals_are_answered_and_survived(start_node, client):
    node = start_idle(start_node)
    actor = client()
    broken = task_to_message(TASK, 0, 'base_link')
    broken.goals[1].pose.position.x = math.nan
    for goal, word in (
        (action_goal(task=broken), 'p_2'),
        (action_goal(task=TaskMessage(name='empty')), 'goals'),
        (action_goal(dof=0), 'dof'),
        (action_goal(dof=2, order=3), 'dof'),
        (action_goal(lower=1.0, upper=-1.0), 'limits'),
        (action_goal(time_budget=math.nan), 'time_budget'),
        (action_goal(method='guess'), 'worst_cases'),
        (action_goal(joint_limits=[-1.0, 1.0, 0.0]), 'joint_limits'),
        (action_goal(regions=[TaskRegion(radius=1.0)]), 'size'),
        (action_goal(regions=[TaskRegion(shape=TaskRegion.SPHERE)]), 'radius'),
        (action_goal(regions=[TaskRegion(shape=7)]), 'shape'),
    ):
        handle = actor.send(goal)
        assert handle.accepted
        answer = actor.result(handle)
        assert answer.status == GoalStatus.STATUS_ABORTED
        assert word in answer.result.reason
    assert node.running


def test_a_task_message_starts_a_search(start_node, probe):
    start_idle(start_node)
    final = probe.listen(DesignCandidate, topics.DESIGN_FINAL, topics.LATCHED_QOS)
    publisher = probe.publisher(TaskMessage, topics.TASK, topics.LATCHED_QOS)
    message = task_to_message(TASK, 0, 'base_link')
    message.name = 'by_message'
    message.goals[0].pose.position.y = math.inf
    publisher.publish(message)
    message.goals[0].pose.position.y = 0.0
    probe.spin_for(0.3)
    publisher.publish(message)
    probe.until(lambda: final, 60.0, 'the final design')
    assert final[0].task == 'by_message'
    assert final[0].status == DesignCandidate.FINAL_PROVED, final[0].reason


def test_it_ends_promptly_in_the_middle_of_a_search(start_node):
    node = start_node(
        'designer', params={'dof': 3, 'method': 'paredis_1994', 'time_budget': 600.0}
    )
    node.wait_for('searching', 90.0)
    time.sleep(1.0)
    started = time.monotonic()
    assert node.stop(signal.SIGINT) in (0, 128 + signal.SIGINT)
    assert time.monotonic() - started < 4.0


def test_a_task_it_cannot_read_is_named(start_node):
    node = start_node('designer', params={'task': 'no_such_task'})
    node.wait_for('no_such_task')
    assert node.running


def test_it_leaves_a_confirmed_certificate_and_a_report(start_node, probe, tmp_path):
    final = probe.listen(DesignCandidate, topics.DESIGN_FINAL, topics.LATCHED_QOS)
    proof, picture = tmp_path / 'proof.json', tmp_path / 'report.png'
    start_node('designer', params={'certificate': str(proof), 'report': str(picture)})
    probe.until(lambda: final, 120.0, 'the final design')
    assert final[0].status == DesignCandidate.FINAL_PROVED, final[0].reason
    assert 'the independent verifier confirms all 3 goals' in final[0].reason
    document = load_certificate(proof)
    goals = [goal['point'] for goal in document['goals']]
    assert goals == [goal.position.tolist() for goal in TASK.goals]
    assert [ok for ok, _ in verify(document)] == [True] * 3
    assert picture.read_bytes().startswith(b'\x89PNG')
    assert sorted(path.name for path in tmp_path.iterdir()) == ['proof.json', 'report.png']


def test_a_certificate_that_could_not_be_written_is_named(start_node, tmp_path):
    node = start_node('designer', params={'certificate': str(tmp_path / 'missing' / 'proof.json')})
    node.wait_for('parameter certificate: no file can be written in')
