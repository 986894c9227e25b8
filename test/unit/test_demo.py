"""What the demo decides by itself: what contradicts the story, and what locks when."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import Goal, Task
from ft_manip_ros.core.joint_path import JointPath
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.nodes.demo_options import chosen_joints, parse_options
from ft_manip_ros.nodes.demo_picture import draw, link_points
from ft_manip_ros.nodes.demo_record import Point, Record
from ft_manip_ros.nodes.demo_run import NotNeededError, choose_failure, start_posture
from ft_manip_ros.nodes.demo_timeline import table

ARM = load_arm('paredis_table_3')
JOINT = 'joint_2'
START = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
LOCKED = START + 0.3
END = np.where(np.arange(5) == 1, LOCKED, START - 0.4)
SECOND = 1_000_000_000


def record():
    """A run in which all went well: up together, joint 2 locks at 1 s, the rest goes on."""
    times = np.arange(0.0, 4.0, 0.01)
    ramp = np.clip(times, 0.0, 1.0)[:, None]
    back = np.clip(times - 2.0, 0.0, 1.0)[:, None]
    positions = START + ramp * (LOCKED - START) + back * (END - LOCKED)
    goals = tuple(
        Goal(fk(ARM, q)[1], id=name) for name, q in (('first', positions[50]), ('last', END))
    )
    healthy = JointPath(ARM.joint_names, np.array([0.0, 2.0]), np.array([START, START + 0.6]))
    recovery = JointPath(ARM.joint_names, np.array([0.0, 1.0]), np.array([LOCKED, END]))
    return Record(
        ARM,
        Task('two', goals),
        JOINT,
        fault_tolerant=True,
        stamps=np.round(times * SECOND).astype(np.int64),
        positions=positions,
        commands=[(0, healthy), (2 * SECOND, recovery)],
        started=0,
        locked_at=SECOND,
        frozen_truth=float(LOCKED[1]),
        detected_stamp=round(1.1 * SECOND),
        detected_heard=round(1.12 * SECOND),
        detected_position=float(LOCKED[1]),
        detected_sigma=1e-5,
        plan_heard=round(1.2 * SECOND),
        plan_status='finishes',
        points=[
            Point('first', goals[0].position, 'reached before', '', 0.0, SECOND // 2),
            Point('last', goals[1].position, 'reachable', '', 1e-5, 3 * SECOND),
        ],
    )


def test_a_run_as_it_should_be_has_no_problems():
    good = record()
    assert good.problems() == []
    assert good.detection_latency == pytest.approx(0.12)
    assert good.plan_latency == pytest.approx(0.2)
    assert good.worst_error == 1e-5
    distances = good.distances()
    assert distances.shape == (400, 2)
    assert distances[50, 0] == pytest.approx(0.0, abs=1e-12)
    assert distances[-1, 1] == pytest.approx(0.0, abs=1e-12)


def moving_after_lock(run):
    positions = run.positions.copy()
    positions[300:, 1] += 0.01
    return replace(run, positions=positions)


def commanded(run, q_end, duration=1.0):
    path = JointPath(ARM.joint_names, np.array([0.0, duration]), np.array([LOCKED, q_end]))
    return replace(run, commands=[run.commands[0], (2 * SECOND, path)])


@pytest.mark.parametrize(
    ('change', 'complaint'),
    [
        (moving_after_lock, 'moved by'),
        (lambda r: replace(r, detected_position=r.frozen_truth + 0.01), 'wrong by'),
        (lambda r: replace(r, detected_position=float('nan')), 'wrong by'),
        (lambda r: replace(r, falsely_locked=('joint_4',)), 'joint_4'),
        (lambda r: replace(r, plan_status='partial'), 'proved fault tolerant'),
        (lambda r: replace(r, points=[replace(r.points[1], error=2e-3)]), 'missed by 2.00 mm'),
        (lambda r: replace(r, points=[replace(r.points[0], error=2e-3)]), 'missed by 2.00 mm'),
        (lambda r: commanded(r, END + 0.01 * np.eye(5)[1]), 'joint_2 was commanded to move'),
        (lambda r: commanded(r, END, 0.2), 'speed limits were exceeded in command: joint_1'),
        (
            lambda r: commanded(r, np.where(np.arange(5) == 3, 2.7, LOCKED), 20.0),
            'position limits were exceeded in command: joint_4',
        ),
    ],
)
def test_every_contradiction_is_named(change, complaint):
    problems = change(record()).problems()
    assert len(problems) == 1
    assert complaint in problems[0]


def test_points_told_to_be_lost_are_no_contradiction():
    run = replace(record(), fault_tolerant=False, plan_status='partial')
    run.points[1] = replace(run.points[1], fate='lost', error=0.2)
    assert run.problems() == []
    row = table([run], [[]]).splitlines()[1]
    assert '0 of 1 left' in row
    assert 'as promised' in row


def test_only_joints_that_still_have_a_way_to_go_are_locked():
    q = np.array([[0.0] * 5, [0.0, 1.0, 0.0, 0.0, 0.0], [0.5, 1.0, 0.0, 0.0, 0.0]])
    path = JointPath(ARM.joint_names, np.array([0.0, 2.0, 4.0]), q)
    chosen = [
        choose_failure(path, list(ARM.joint_names), 4.0, np.random.default_rng(seed))
        for seed in range(40)
    ]
    assert {joint for joint, _ in chosen} == {'joint_1', 'joint_2'}
    for joint, moment in chosen:
        assert moment < (4.0 - 0.5 if joint == 'joint_1' else 2.0 - 0.25)
    again = choose_failure(path, list(ARM.joint_names), 4.0, np.random.default_rng(0))
    assert again == chosen[0]
    with pytest.raises(NotNeededError, match='joint_5'):
        choose_failure(path, ['joint_5'], 4.0, np.random.default_rng(0))


def test_the_start_is_within_the_operating_limits():
    for seed in range(50):
        q = start_posture(ARM, np.random.default_rng(seed))
        assert np.all((q > ARM.operating_lower) & (q < ARM.operating_upper))


def test_the_drawn_arm_ends_at_the_tool():
    q = start_posture(ARM, np.random.default_rng(4))
    points = link_points(ARM, q)
    assert points.shape == (7, 3)
    np.testing.assert_allclose(points[-1], fk(ARM, q)[1], atol=1e-12)
    # Between two joints lies one link: its length is that of the DH row.
    lengths = np.linalg.norm(np.diff(points[1:], axis=0), axis=1)
    np.testing.assert_allclose(lengths, np.linalg.norm(ARM.translations[1:], axis=1), atol=1e-12)


def test_the_picture_is_drawn(tmp_path):
    draw(record(), tmp_path / 'run.png')
    content = (tmp_path / 'run.png').read_bytes()
    assert content.startswith(b'\x89PNG')
    assert len(content) > 20_000


def test_joints_are_chosen_by_name_by_number_or_all():
    assert chosen_joints('', ARM) == []
    assert chosen_joints('2', ARM) == ['joint_2']
    assert chosen_joints('joint_4', ARM) == ['joint_4']
    assert chosen_joints('all', ARM) == list(ARM.joint_names)
    for wrong in ('0', '6', 'wrist'):
        with pytest.raises(InputError, match='joint'):
            chosen_joints(wrong, ARM)


def test_options_have_sensible_defaults(tmp_path):
    options = parse_options(['--output', str(tmp_path)])
    assert (options.arm, options.task, options.joint) == ('', 'paredis_eq_11', '')
    panda = parse_options(['--arm', 'panda'])
    assert panda.arm.endswith('panda.urdf')
    assert (panda.base, panda.tip, panda.task) == ('panda_link0', 'panda_hand_tcp', 'panda_reach')
    for wrong in (['--seed', '-1'], ['--domain', '300'], ['--design-time', '0']):
        with pytest.raises(SystemExit) as stop:
            parse_options(wrong)
        assert stop.value.code == 2
