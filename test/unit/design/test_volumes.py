"""Volumes of points: what is proved of them, and what is not, checked by brute force."""

import numpy as np
import pytest

from ft_manip_ros.core.arm_file import load_dh
from ft_manip_ros.core.design.problem import design_problem
from ft_manip_ros.core.design.proof import prove
from ft_manip_ros.core.design.search import design_arm
from ft_manip_ros.core.design.search_goals import with_balls
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.verdict import Verdict
from ft_manip_ros.core.goal import DesignSpec, Goal, Task
from ft_manip_ros.core.region import Box, Sphere
from ft_manip_ros.core.task_file import load_task
from support.dense_reach import worst_miss

EQ_11 = load_task('paredis_eq_11')
TASK = Task(
    'volumes',
    (
        Goal(np.array([0.5, 0.0, 0.5]), id='point'),
        Goal(np.array([0.4, 0.3, 0.4]), id='box', region=Box((0.06, 0.04, 0.02))),
        Goal(np.array([0.3, -0.4, 0.3]), id='ball', region=Sphere(0.02)),
    ),
)


def check_by_brute_force(table, points):
    lower = np.array([joint.lower for joint in table.joints])
    upper = np.array([joint.upper for joint in table.joints])
    for point in points:
        miss, where = worst_miss(
            table.d, table.a, table.alpha, lower, upper, point, angles=5, starts=60
        )
        assert miss < 1e-5, f'{point} is missed by {miss} m with {where}'


def test_volumes_are_covered_whole():
    limits = (-2.4, -2.6, -2.6, -2.6, -2.8), (2.4, 2.6, 2.6, 2.6, 2.8)
    result = design_arm(TASK, DesignSpec(5, 1, *limits), DesignSettings(seed=2))
    assert result.proved, result.reason
    assert '2 whole regions' in result.reason
    assert [joint.lower for joint in result.table.joints] == list(limits[0])
    assert len(result.goal_penalties) == 3
    rng = np.random.default_rng(0)
    point, box, ball = result.proof.covers
    assert len(point) == 0
    for cover, goal in ((box, TASK.goals[1]), (ball, TASK.goals[2])):
        inside = rng.uniform(-1.0, 1.0, (400, 3)) * goal.region.half
        if goal.id == 'ball':
            inside = inside[np.linalg.norm(inside, axis=1) <= goal.region.radius]
        points = goal.position + inside
        near = np.abs(points[:, None] - cover[None, :, :3]) <= cover[None, :, 3:] + 1e-12
        assert near.all(axis=2).any(axis=1).all()
        # What a cover says of a point, another implementation confirms.
        check_by_brute_force(result.table, [goal.position + goal.region.surface()[7], points[0]])


def test_every_goal_may_stand_for_a_ball():
    task = with_balls(EQ_11, 0.005)
    result = design_arm(EQ_11, settings=DesignSettings(seed=2, ball=0.005))
    assert result.proved, result.reason
    for verdict, goal in zip(result.proof.verdicts, task.goals, strict=True):
        assert verdict.margin == 0.005
        assert 'covered' in verdict.reason
        check_by_brute_force(result.table, [goal.position + goal.region.surface()[3]])


def test_what_is_not_reached_whole_is_not_proved():
    # Table 3 reaches the points, but not everything within half a metre of them.
    chain = load_dh('paredis_table_3').chain()
    for region in (Sphere(0.5), Box((1.0, 1.0, 1.0))):
        goal = Goal(EQ_11.goals[0].position, region=region)
        proof = prove(chain, Task('large', (goal,)), 1)
        assert not proof.proved
        assert proof.verdicts[-1].verdict is not Verdict.MEMBER
        assert str(region) in proof.reason
        offset = proof.failed_at - goal.position
        assert region.nearest(offset, np.zeros(3)) is not None


def test_a_proof_that_is_stopped_proves_nothing():
    goal = Goal(EQ_11.goals[0].position, region=Sphere(0.5))
    proof = prove(load_dh('paredis_table_3').chain(), Task('large', (goal,)), 1, lambda: True)
    assert not proof.proved


@pytest.mark.parametrize('region', [Sphere(0.3), Box((0.2, 0.4, 0.6))])
def test_nearest_points_lie_in_the_cell_and_in_the_region(region):
    rng = np.random.default_rng(1)
    samples = rng.uniform(-1.0, 1.0, (4000, 3)) * region.half
    if isinstance(region, Sphere):
        samples = samples[np.linalg.norm(samples, axis=1) <= region.radius]
    found = 0
    for _ in range(200):
        center, half = rng.uniform(-1.3, 1.3, 3) * region.half, rng.uniform(0.01, 0.1, 3)
        nearest = region.nearest(center, half)
        shared = (np.abs(samples - center) <= half).all(axis=1)
        if nearest is None:
            assert not shared.any()
            continue
        found += 1
        assert (np.abs(nearest - center) <= half + 1e-12).all()
        assert (np.abs(nearest) <= region.half + 1e-12).all()
    assert found > 10


def test_points_of_a_region_count_for_its_goal():
    problem = design_problem(TASK, DesignSpec(5), DesignSettings(margin=0.1))
    assert problem.goal_count == 3
    assert len(problem.goals.positions) == 3 + 14 + 14
    shares = problem.per_goal(np.arange(40.0))
    np.testing.assert_allclose(shares, [0.0, 1 + sum(range(3, 17)), 2 + sum(range(17, 31))])
    guarded, _ = problem.guarded(1.0)
    np.testing.assert_array_equal(guarded.positions[:31], problem.goals.positions)
    # Room is asked for outside the volume.
    beyond = guarded.positions[31 + 4 : 31 + 4 + 14] - TASK.goals[1].position
    assert (np.abs(beyond) > TASK.goals[1].region.half).any(axis=1).all()


@pytest.mark.parametrize('size', [(0.1, 0.1, 0.0), (0.1, -1.0, 0.1), (0.1, np.nan, 0.1)])
def test_boxes_need_edges(size):
    with pytest.raises(InputError, match='size'):
        Box(size)


@pytest.mark.parametrize('radius', [0.0, -1.0, np.inf, np.nan])
def test_spheres_need_a_radius(radius):
    with pytest.raises(InputError, match='radius'):
        Sphere(radius)
