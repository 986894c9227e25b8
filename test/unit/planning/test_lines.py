"""Straight tool motion between goals: kept along the whole motion, or refused with the reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.link_capsules import capsule_model
from ft_manip_ros.core.planning.obstacles import load_obstacles
from ft_manip_ros.core.planning.plan import Outcome, PlanStatus
from ft_manip_ros.core.planning.replan import plan_task
from ft_manip_ros.core.planning.settings import PlanSettings, Relaxation

ARM = load_arm('paredis_table_3')
PANDA = load_arm(
    'package://example-robot-data/robots/panda_description/urdf/panda.urdf',
    base='panda_link0',
    tip='panda_link8',
)
READY = np.array([0.0, -0.4, 0.0, -2.0, 0.0, 1.6, 0.8])
START = np.array([0.3, 0.5, -0.7, 0.9, -0.4])


def beside(position, offset):
    return position + np.array(offset)


def plan(chain, goals, start, frozen=None, speed=0.0, **options):
    checker = options.pop('checker', None)
    return plan_task(
        chain,
        list(enumerate(goals)),
        frozen=frozen or {},
        sigma={},
        start=start,
        start_velocity=np.full(chain.n, speed) * [name not in (frozen or {})
                                                  for name in chain.joint_names],
        settings=PlanSettings(**options),
        checker=checker,
    )  # fmt: skip


def between(chain, trajectory, begin, end):
    """Tool rotations and positions every 5 ms of the motion that a controller makes of a plan."""
    path = trajectory.path()
    times = np.arange(begin, end, 0.005)
    return fk(chain, np.array([path.sample(float(t))[0] for t in times]))


def off_line(points, a, b):
    """Largest distance of points, (T, 3), from the segment from a to b."""
    way = (b - a) / np.linalg.norm(b - a)
    along = np.clip((points - a) @ way, 0.0, np.linalg.norm(b - a))
    return np.linalg.norm(points - a - along[:, None] * way, axis=1).max()


def test_pose_goals_of_a_locked_panda_are_joined_by_a_straight_line():
    rotation, position = fk(PANDA, READY)
    frozen = {'panda_joint3': 0.0}
    goals = [
        Goal(beside(position, [0.0, 0.1, 0.05]), rotation),
        Goal(beside(position, [0.05, -0.15, 0.0]), rotation, straight_line=True),
    ]
    found = plan(PANDA, goals, READY, frozen, 0.2)
    assert found.status == PlanStatus.FINISHES, found.reason
    a, b = (outcome.arrival for outcome in found.outcomes)
    rotations, tools = between(PANDA, found.trajectory, a, b)
    assert off_line(tools, goals[0].position, goals[1].position) < 1e-3
    # Both poses have the same orientation, so it is held all the way.
    assert np.abs(rotations - rotation).max() < 1e-2
    # A move straight in joint space is none of the tool.
    goals[1] = replace(goals[1], straight_line=False)
    bent = plan(PANDA, goals, READY, frozen, 0.2)
    a, b = (outcome.arrival for outcome in bent.outcomes)
    _, tools = between(PANDA, bent.trajectory, a, b)
    assert off_line(tools, goals[0].position, goals[1].position) > 2e-3


def test_the_first_line_begins_where_the_arm_comes_to_rest():
    _, position = fk(ARM, START)
    goal = Goal(beside(position, [-0.2, 0.1, 0.1]), straight_line=True)
    found = plan(ARM, [goal], START, speed=0.3)
    assert found.status == PlanStatus.FINISHES, found.reason
    halt = plan(ARM, [goal], START, speed=0.3, accepted=frozenset()).trajectory
    assert np.all(halt.velocities[0] == 0.3)
    # From its stop on, its tool stays on the line.
    still = np.flatnonzero(np.abs(halt.velocities).max(axis=1) == 0.0)
    begin = float(halt.times[still[0]])
    _, tools = between(ARM, found.trajectory, begin, found.outcomes[0].arrival)
    assert off_line(tools, tools[0], goal.position) < 1e-3


def test_a_line_that_the_arm_cannot_follow_is_refused_with_how_far_it_goes_and_why():
    # From one side of the base to the other: straight through where no posture is.
    goals = [
        Goal([0.0, 0.45, 0.35], id='one side'),
        Goal([0.0, -0.45, 0.35], id='other side', straight_line=True),
    ]
    rotation = fk(PANDA, READY)[0]
    goals = [replace(goal, orientation=rotation, free_axis=True) for goal in goals]
    refused = plan(PANDA, goals, READY)
    assert refused.status == PlanStatus.PARTIAL
    fate = refused.outcomes[1]
    assert fate.outcome == Outcome.RELAXED
    assert fate.relaxation == 'line dropped'
    assert 'the straight line from one side ends after' in fate.reason
    assert not fate.has_posture
    accepted = plan(PANDA, goals, READY, accepted=frozenset({Relaxation.LINE_DROPPED}))
    assert accepted.status == PlanStatus.FINISHES


def test_a_line_through_an_obstacle_is_refused(tmp_path):
    around = tmp_path / 'around.yaml'
    _, position = fk(ARM, START)
    middle = beside(position, [0.0, 0.25, 0.0])
    around.write_text(f'obstacles: [{{name: ball, sphere: 0.05, position: {middle.tolist()}}}]')
    bodies = capsule_model(ARM, 0.01, load_obstacles(str(around)), 0.005)
    goal = Goal(beside(position, [0.0, 0.5, 0.0]), id='behind', straight_line=True)
    assert plan(ARM, [goal], START).status == PlanStatus.FINISHES
    found = plan(ARM, [goal], START, checker=CollisionChecker(bodies))
    assert found.outcomes[0].relaxation == 'line dropped'
    assert 'ball' in found.outcomes[0].reason or 'touch' in found.outcomes[0].reason


def test_a_line_from_a_goal_that_is_not_visited_has_no_beginning():
    _, position = fk(ARM, START)
    goals = [
        Goal([0.0, 0.0, 9.0], id='far'),
        Goal(beside(position, [0.1, 0.0, 0.0]), straight_line=True),
    ]
    found = plan(ARM, goals, START)
    assert found.outcomes[0].outcome == Outcome.LOST
    assert 'has no beginning: far is not visited' in found.outcomes[1].reason


@pytest.mark.parametrize('joint', ARM.joint_names)
def test_lines_stay_within_limits_whichever_joint_is_locked(joint):
    _, position = fk(ARM, START)
    frozen = {joint: START[ARM.index(joint)]}
    goals = [
        Goal(position + offset, straight_line=True)
        for offset in ([0.0, 0.2, 0.0], [0.0, 0.2, 0.2], [0.0, 0.0, 0.0])
    ]
    found = plan(ARM, goals, START, frozen)
    # What leaves has passed the gate; whatever cannot be followed is named.
    assert found.status in (PlanStatus.FINISHES, PlanStatus.PARTIAL, PlanStatus.HALTED)
    for outcome in found.outcomes:
        assert outcome.has_posture or 'straight line' in outcome.reason
