"""What a motion survives: known truths of planar arms, and paths that survive more."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ft_manip_ros.cli.main import main
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.planning.limits import motion_limits
from ft_manip_ros.core.planning.replan import plan_task
from ft_manip_ros.core.planning.safety import check_trajectory
from ft_manip_ros.core.planning.settings import PlanSettings
from ft_manip_ros.core.planning.tolerance import Fate, tolerance_map
from ft_manip_ros.core.planning.tolerant_path import most_tolerant_path
from ft_manip_ros.core.task_file import load_task
from support.chains import REAL_ARMS

SETTINGS = PlanSettings()


def judged(arm, goals, samples=12):
    plan = plan_task(
        arm,
        list(enumerate(goals)),
        frozen={},
        sigma={},
        start=np.full(arm.n, 0.4),
        start_velocity=np.zeros(arm.n),
        settings=SETTINGS,
    )
    arrivals = {o.index: o.arrival for o in plan.outcomes if o.has_posture}
    assert len(arrivals) == len(goals)
    found = tolerance_map(
        arm, goals, plan.trajectory, arrivals, samples=samples, settings=SETTINGS
    )
    return found, arrivals, plan.trajectory


def test_a_fault_tolerant_arm_survives_every_lock():
    # 4R planar, unit links: its fault-tolerant work space is the disc of radius 2.
    goals = [Goal(np.array([1.0, 0.8, 0.0])), Goal(np.array([-0.5, 1.2, 0.0]))]
    found, _, _ = judged(load_arm('planar_4r'), goals)
    assert np.all(found.fates == Fate.SURVIVED)
    assert found.any_joint == 1.0
    assert np.all(found.culprits == -1)


def test_a_three_joint_arm_against_plane_geometry():
    # 3R planar, unit links, any one joint locked is a two-link arm: the goal has to lie in its
    # annulus, about the elbow where joint 1 is locked, else about the base.
    goals = [Goal(np.array([2.2, 0.3, 0.0])), Goal(np.array([-1.1, 1.9, 0.0]))]
    arm = load_arm('planar_3r')
    found, arrivals, trajectory = judged(arm, goals, samples=60)
    for row, time in enumerate(found.times):
        q, _ = trajectory.path().sample(time)
        left = [goals[k].position for k in arrivals if arrivals[k] > time]
        for joint in range(3):
            slack = [_annulus_slack(joint, q[joint], goal) for goal in left]
            if min(np.abs(slack), default=1.0) < 5e-3:
                continue  # at the rim the tolerance of the goal decides
            wanted = Fate.SURVIVED if min(slack, default=1.0) > 0.0 else Fate.LOST
            assert found.fates[row, joint] == wanted, (time, joint, slack)
    assert 0.0 < found.any_joint < 1.0


def _annulus_slack(joint, angle, goal):
    """How far (m) a goal lies within the annulus of the two links that are left."""
    if joint == 0:
        distance = np.hypot(goal[0] - np.cos(angle), goal[1] - np.sin(angle))
        return 2.0 - distance
    merged = abs(1.0 + np.exp(1j * angle))
    distance = np.hypot(goal[0], goal[1])
    return min(1.0 + merged - distance, distance - abs(1.0 - merged))


def test_a_lock_that_loses_is_proved_and_names_the_goal():
    # Two links: with the elbow locked the tool keeps its distance, so the next goal is lost.
    arm = load_arm('planar_3r').freeze({'joint_3': 0.0})
    goals = [Goal(np.array([1.0, 2.0, 0.0])), Goal(np.array([0.0, 1.4, 0.0]))]
    found, arrivals, _ = judged(arm, goals)
    before = found.times < arrivals[1]
    assert np.all(found.fates[before][:, 1] == Fate.LOST)
    assert found.proved_lost[1] == pytest.approx(np.mean(before))
    assert set(found.culprits[before][:, 1]) <= {0, 1}


def test_a_better_path_survives_more_on_a_seven_joint_arm():
    urdf, base, tip, _ = REAL_ARMS['panda']
    arm = load_arm(urdf, base=base, tip=tip)
    goals = load_task('panda_reach').goals
    start = np.where((arm.lower <= 0) & (arm.upper >= 0), 0.0, 0.5 * (arm.lower + arm.upper))
    plan = plan_task(
        arm,
        list(enumerate(goals)),
        frozen={},
        sigma={},
        start=start,
        start_velocity=np.zeros(arm.n),
        settings=SETTINGS,
    )
    arrivals = {o.index: o.arrival for o in plan.outcomes}
    quick = PlanSettings(proof_boxes=1)
    before = tolerance_map(arm, goals, plan.trajectory, arrivals, samples=25, settings=quick)
    path = most_tolerant_path(arm, goals, start, SETTINGS)
    after = tolerance_map(arm, goals, path.trajectory, path.arrivals, samples=25, settings=quick)
    assert after.any_joint > before.any_joint
    limits = motion_limits(arm, operating=True, jerk_time=SETTINGS.jerk_time)
    assert (
        check_trajectory(
            arm,
            path.trajectory,
            limits,
            frozen={},
            start=start,
            start_velocity=np.zeros(arm.n),
        )
        == ()
    )


def test_command_prints_one_object_and_writes_path_and_picture(tmp_path, capsys):
    path, picture = tmp_path / 'path.csv', tmp_path / 'map.png'
    arguments = ['tolerance', 'paredis_table_3', 'paredis_eq_11', '--samples', '5', '--json']
    assert main([*arguments, '--output', str(path), '--plot', str(picture)]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert set(answer) == {'planned', 'most tolerant'}
    # The paper's claim: these goals survive any lock.
    assert answer['planned']['any_joint'] == 1.0
    assert np.shape(answer['planned']['fates']) == (5, 5)
    rows = np.loadtxt(path, delimiter=',', skiprows=1)
    assert rows.shape[1] == 6
    assert rows[-1, 0] == pytest.approx(answer['most tolerant']['duration'])
    assert picture.read_bytes().startswith(b'\x89PNG')


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--samples', '1'], '--samples'),
        (['--start', '0', '0'], '--start'),
        (['--start', 'nan', '0', '0', '0', '0'], '--start'),
    ],
)
def test_bad_arguments_are_named(arguments, words, capsys):
    assert main(['tolerance', 'paredis_table_3', 'paredis_eq_11', *arguments]) == 2
    assert words in capsys.readouterr().err
