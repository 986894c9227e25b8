"""Collision: bodies, motions judged without gaps, plans that go round or say why they cannot."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest

from bench.free_space import FreeSpace
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.config_files import find_config
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.joint import Joint
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.link_capsules import capsule_model
from ft_manip_ros.core.planning.obstacles import Obstacle, load_obstacles
from ft_manip_ros.core.planning.plan import Outcome, PlanStatus
from ft_manip_ros.core.planning.proof import needs_proof
from ft_manip_ros.core.planning.replan import plan_task
from ft_manip_ros.core.planning.settings import PlanSettings, Policy
from ft_manip_ros.core.planning.urdf_bodies import urdf_model
from support.chains import REAL_ARMS


def planar(count):
    joints = tuple(Joint(f'j{i}', -np.pi, np.pi) for i in range(count))
    translations = np.zeros((count + 1, 3))
    translations[1:, 0] = 1.0
    return SerialChain('planar', joints, np.tile(np.eye(3), (count + 1, 1, 1)), translations)


def ball(position, radius=0.1):
    return Obstacle('ball', 'sphere', (radius,), np.array(position, float), np.eye(3))


ARM = planar(2)


def checker(*obstacles, padding=0.01, arm=ARM):
    return CollisionChecker(capsule_model(arm, 0.05, obstacles, padding))


def test_distance_to_a_ball_by_plane_geometry():
    # A straight arm along x; a ball beside its second link.
    q = np.zeros(2)
    for gap, wanted in ((0.005, True), (0.015, False)):
        close = checker(ball([1.5, 0.05 + 0.1 + gap, 0.0]))
        assert close.touches(q) is wanted
    touching = checker(ball([1.5, 0.1, 0.0])).touching(q)
    assert touching == ('link of j1', 'ball')
    assert checker(ball([1.5, 0.5, 0.0])).touching(q) is None


def test_links_next_to_each_other_are_not_checked_and_others_are():
    arm = planar(4)
    judge = checker(arm=arm)
    assert not judge.touches(np.zeros(4))
    # Three right angles close a square: the last link lies on the first.
    assert judge.touches(np.full(4, np.pi / 2.0))


@pytest.mark.parametrize('seed', range(3))
def test_no_move_passes_a_ball_unseen(seed):
    # Against dense sampling of the same moves.
    rng = np.random.default_rng(seed)
    judge = checker(ball([1.2, 0.4, 0.0], 0.03), padding=0.005)
    exact = checker(ball([1.2, 0.4, 0.0], 0.03), padding=1e-9)
    seen = {True: 0, False: 0}
    for _ in range(60):
        a, b = rng.uniform(-np.pi, np.pi, (2, 2))
        dense = any(exact.touches(a + s * (b - a)) for s in np.linspace(0.0, 1.0, 400))
        found = judge.move_touches(a, b)
        seen[found] += 1
        if dense:
            assert found
    assert min(seen.values()) > 5


def planned(goals, start, judge, *, frozen=None, velocity=None, settings=None, arm=ARM):
    return plan_task(
        arm,
        list(enumerate(goals)),
        frozen=frozen or {},
        sigma={},
        start=np.array(start),
        start_velocity=np.zeros(arm.n) if velocity is None else np.array(velocity),
        settings=settings or PlanSettings(),
        checker=judge,
    )


def assert_free(plan, judge):
    for k in range(len(plan.trajectory.times) - 1):
        a, b = plan.trajectory.positions[k : k + 2]
        assert not judge.move_touches(a, b)
    assert judge.first_touch(plan.trajectory.times, plan.trajectory.positions) is None


def test_plan_goes_round_what_blocks_the_straight_way():
    # From straight ahead to straight up, with a ball in the sector the tool sweeps.
    judge = checker(ball([1.5, 1.5, 0.0], 0.15))
    goals = [Goal(np.array([0.0, 1.9, 0.0]))]
    blind = planned(goals, [0.1, -0.2], None)
    assert judge.first_touch(blind.trajectory.times, blind.trajectory.positions) is not None
    plan = planned(goals, [0.1, -0.2], judge)
    assert plan.status == PlanStatus.FINISHES
    assert_free(plan, judge)
    assert plan.trajectory.duration > blind.trajectory.duration
    at, _ = plan.trajectory.path().sample(plan.outcomes[0].arrival)
    assert np.linalg.norm(fk(ARM, at)[1] - goals[0].position) < 1e-3


def test_a_way_with_several_corners_is_found():
    # The whole arm turns about its base between two posts only when it is folded, and folds only
    # away from them: no straight way, and none with one posture in between.
    posts = [ball([1.5 * np.cos(t), 1.5 * np.sin(t), 0.0], 0.1) for t in (0.6, 1.2, 1.8, 2.4)]
    judge = checker(*posts)
    start = [0.0, 0.0]
    goals = [Goal(np.array([2.0 * np.cos(t), 2.0 * np.sin(t), 0.0])) for t in (0.9, 1.5, 2.1, 2.7)]
    plan = planned(goals, start, judge)
    assert plan.status == PlanStatus.FINISHES
    assert_free(plan, judge)
    again = planned(goals, start, judge)
    np.testing.assert_array_equal(plan.trajectory.positions, again.trajectory.positions)


def test_where_no_way_is_found_there_is_none_on_a_fine_grid():
    arm = planar(3)
    rng = np.random.default_rng(5)
    ends = {True: 0, False: 0}
    for _ in range(12):
        balls = [ball([*rng.uniform(-2.5, 2.5, 2), 0.0], 0.2) for _ in range(4)]
        judge = checker(*balls, arm=arm)
        locked = float(rng.uniform(-1.5, 1.5))

        def posture(judge=judge, locked=locked):
            while True:
                q = rng.uniform(-np.pi, np.pi, 3)
                q[1] = locked
                if not judge.touches(q):
                    return q

        start, frozen = posture(), {'j1': locked}
        goals = [Goal(fk(arm, posture())[1]) for _ in range(3)]
        plan = planned(goals, start, judge, frozen=frozen, arm=arm)
        finished = plan.status == PlanStatus.FINISHES
        ends[finished] += 1
        if finished:
            assert_free(plan, judge)
        else:
            open_ones = [o.goal for o in plan.outcomes if not o.has_posture]
            space = FreeSpace(arm, judge, frozen, grid=90)
            assert not any(space.connects(start, [goal]) for goal in open_ones)
    assert min(ends.values()) >= 2


def test_other_postures_are_looked_for_when_those_found_touch():
    # Elbow up or down: only one of them is free, whichever is found first.
    goal = Goal(np.array([1.2, 0.9, 0.0]))
    one = PlanSettings(postures=1)
    blind = planned([goal], [0.3, 0.3], None, settings=one)
    elbow = fk(ARM, blind.outcomes[0].posture)[1] * 0.0
    first = blind.outcomes[0].posture[0]
    elbow[:2] = np.cos(first), np.sin(first)
    judge = checker(ball(elbow, 0.1))
    plan = planned([goal], [0.3 - 2.0, 0.3], judge, settings=one)
    assert plan.status == PlanStatus.FINISHES
    assert np.sign(plan.outcomes[0].posture[1]) == -np.sign(blind.outcomes[0].posture[1])
    assert_free(plan, judge)


def test_goal_inside_an_obstacle_is_open_and_named():
    judge = checker(ball([0.0, 1.5, 0.0], 0.2))
    plan = planned(
        [Goal(np.array([0.0, 1.5, 0.0])), Goal(np.array([1.2, 0.8, 0.0]))], [0, 0], judge
    )
    first, second = plan.outcomes
    assert first.outcome == Outcome.UNDECIDED
    assert 'ball touch' in first.reason
    assert second.has_posture
    assert plan.status == PlanStatus.PARTIAL
    # There is a posture, so there is nothing to refute.
    assert not needs_proof(plan)
    assert_free(plan, judge)


def test_standing_in_an_obstacle_is_a_halt_that_says_so():
    judge = checker(ball([1.5, 0.0, 0.0]))
    plan = planned([Goal(np.array([0.0, 1.5, 0.0]))], [0.0, 0.0], judge)
    assert plan.status == PlanStatus.HALTED
    assert 'link of j1 and ball touch' in plan.reason


def test_the_frozen_limb_is_checked_too_and_a_wall_cuts_off():
    # The elbow is locked straight; a ring of balls leaves the arm one half of the plane.
    walls = [ball([1.5 * np.cos(t), 1.5 * np.sin(t), 0.0], 0.1) for t in (-1.5, 1.5)]
    judge = checker(*walls)
    goals = [Goal(np.array([2.0 * np.cos(t), 2.0 * np.sin(t), 0.0])) for t in (0.8, 2.5)]
    frozen = {'j1': 0.0}
    plan = planned(goals, [0.0, 0.0], judge, frozen=frozen)
    assert [o.has_posture for o in plan.outcomes] == [True, False]
    assert 'no way there' in plan.outcomes[1].reason
    assert plan.outcomes[1].outcome == Outcome.UNDECIDED
    assert_free(plan, judge)
    strict = PlanSettings(policy=Policy.FINISH_ALL_OR_HALT)
    halted = planned(goals, [0.0, 0.0], judge, frozen=frozen, settings=strict)
    assert halted.status == PlanStatus.HALTED
    assert not any(o.has_posture for o in halted.outcomes)


def test_a_moving_arm_stops_first_then_moves_free():
    judge = checker(ball([1.5, 1.5, 0.0], 0.15))
    plan = planned([Goal(np.array([0.0, 1.9, 0.0]))], [0.0, -0.2], judge, velocity=[0.3, 0.2])
    assert plan.status == PlanStatus.FINISHES
    np.testing.assert_allclose(plan.trajectory.velocities[0], [0.3, 0.2])
    assert_free(plan, judge)


def test_what_touches_while_the_arm_stops_is_named_with_the_time():
    # A small ball that the outer link sweeps over within its way to rest, 0.175 rad.
    in_the_way = ball([1.9 * np.cos(0.1), 1.9 * np.sin(0.1), 0.0], 0.02)
    goal = [Goal(np.array([1.2, 1.2, 0.0]))]
    swept = planned(goal, [0.0, 0.0], checker(in_the_way), velocity=[1.0, 0.0])
    assert 'link of j1 and ball touch while the arm stops, from t = 0.0' in swept.reason
    # What can be avoided still is: from rest on, the way to the goal is free.
    assert swept.status == PlanStatus.FINISHES
    still = planned(goal, [0.0, 0.0], checker(in_the_way))
    assert 'while the arm stops' not in still.reason


def test_own_bodies_that_touch_at_rest_are_let_go_and_named():
    arm = planar(4)
    judge = checker(ball([0.0, 3.0, 0.0]), arm=arm)
    folded = np.full(4, np.pi / 2.0)
    goals = [Goal(np.array([2.5, -1.0, 0.0]))]
    plan = planned(goals, folded, judge, arm=arm)
    assert plan.status == PlanStatus.FINISHES
    assert 'not checked, for they touch' in plan.reason
    # The next plan starts elsewhere: all pairs count again.
    assert (
        planned(goals, np.zeros(4), judge, arm=arm).reason == 'all 1 remaining goals are visited'
    )
    assert judge.touches(folded)


@pytest.mark.parametrize('name', ['panda', 'jaco'])
def test_bodies_of_a_urdf_stand_where_pinocchio_has_them(name):
    urdf, base, tip, _ = REAL_ARMS[name]
    arm = load_arm(urdf, base=base, tip=tip)
    text = find_config('arms', urdf).read_text()
    bodies = urdf_model(arm, text, base)
    assert bodies.source == 'collision bodies of the URDF'
    rng = np.random.default_rng(1)
    q = rng.uniform(arm.lower, arm.upper)
    data = bodies.model.createData()
    pinocchio.framesForwardKinematics(bodies.model, data, bodies.configuration(q))
    at_base = data.oMf[bodies.model.getFrameId(base)]
    tool = (at_base.inverse() * data.oMf[bodies.model.getFrameId(tip)]).translation
    np.testing.assert_allclose(tool, fk(arm, q)[1], atol=1e-9)
    judge = CollisionChecker(bodies)
    touches = np.mean([judge.touches(q) for q in rng.uniform(arm.lower, arm.upper, (60, arm.n))])
    assert 0.0 < touches < 0.6


def test_obstacle_at_the_tool_of_a_real_arm_is_touched():
    urdf, base, tip, _ = REAL_ARMS['panda']
    arm = load_arm(urdf, base=base, tip=tip)
    q = np.array([0.3, -0.4, 0.2, -1.8, 0.1, 1.6, 0.5])
    _, tool = fk(arm, q)
    text = find_config('arms', urdf).read_text()
    assert CollisionChecker(urdf_model(arm, text, base, [ball(tool, 0.02)])).touches(q)
    far = ball(tool + np.array([0.0, 0.0, 0.6]), 0.02)
    assert not CollisionChecker(urdf_model(arm, text, base, [far])).touches(q)


def test_urdf_without_its_meshes_says_so():
    text = (
        '<robot name="r"><link name="a"/><link name="b"><collision><geometry>'
        '<mesh filename="package://nowhere/b.stl"/></geometry></collision></link>'
        '<joint name="j" type="continuous"><parent link="a"/><child link="b"/>'
        '<axis xyz="0 0 1"/></joint></robot>'
    )
    with pytest.raises(InputError, match='bodies cannot be read'):
        urdf_model(load_arm(text), text, None)


def test_obstacle_file(tmp_path):
    path = tmp_path / 'around.yaml'
    path.write_text(
        'obstacles:\n'
        '- {name: table, box: [1.0, 2.0, 0.1], position: [0.5, 0.0, -0.2]}\n'
        '- {sphere: 0.2, position: [0, 1, 0]}\n'
        '- {capsule: [0.1, 0.5], position: [1, 1, 0], orientation: [0, 0.70711, 0, 0.70711]}\n'
    )
    table, sphere, capsule = load_obstacles(path)
    assert (table.name, table.size) == ('table', (1.0, 2.0, 0.1))
    assert sphere.name == 'obstacles[1]'
    np.testing.assert_allclose(capsule.rotation[:, 2], [1.0, 0.0, 0.0], atol=1e-4)
    for text, words in (
        ('obstacles: 3', 'a list'),
        ('- 1', 'obstacles'),
        ('obstacles: [{sphere: 0.2}]', r'obstacles\[0\].position'),
        ('obstacles: [{sphere: -1, position: [0, 0, 0]}]', 'above 0'),
        ('obstacles: [{box: [1, 2], position: [0, 0, 0]}]', 'must be 3'),
        ('obstacles: [{cone: 1, position: [0, 0, 0]}]', 'exactly one of'),
        ('obstacles: [{sphere: .nan, position: [0, 0, 0]}]', 'finite'),
        ('obstacles: [', 'not YAML'),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=words):
            load_obstacles(path)
    with pytest.raises(InputError, match='cannot be read'):
        load_obstacles(tmp_path / 'missing.yaml')
