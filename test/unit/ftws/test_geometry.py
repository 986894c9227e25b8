"""Critical values, templates, reach tables and operating limits."""

import json

import numpy as np
import pytest
import yaml

from ft_manip_ros.cli.main import main
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.ftws.critical import critical_values
from ft_manip_ros.core.ftws.operating_limits import find_operating_limits, intersect
from ft_manip_ros.core.ftws.problem import prepare
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.templates import cover, in_template, smallest_scale
from ft_manip_ros.core.ftws.verdict import Verdict
from ft_manip_ros.core.kinematics import fk, jacobian
from ft_manip_ros.core.urdf_writer import chain_to_urdf
from unit.ftws.arms import planar, table_1


def test_critical_values_are_images_of_singular_postures():
    arm = load_arm('paredis_table_3')
    points, postures = critical_values(arm, 401)
    assert len(points) > 500
    positions = fk(arm, postures)[1]
    np.testing.assert_allclose(np.hypot(positions[:, 0], positions[:, 1]), points[:, 0], atol=1e-9)
    np.testing.assert_allclose(positions[:, 2], points[:, 1], atol=1e-9)
    smallest = np.linalg.svd(jacobian(arm, postures)[:, :3])[1][:, -1]
    assert smallest.max() < 1e-5


def test_the_ftws_boundary_of_table_1_lies_on_its_critical_values():
    points, _ = critical_values(table_1(), 4001)
    turn = np.linspace(-2.0 * np.pi / 3.0, 2.0 * np.pi / 3.0, 41)
    arc = np.stack([1.0 + 2.0 * np.cos(turn), 2.0 * np.sin(turn)], axis=1)
    arc = arc[(arc[:, 0] <= 2.0) & (arc[:, 0] >= 0.0)]
    # At z = 0 the samples of the line thin out: height is a square root of the angle there.
    height = np.linspace(0.3, np.sqrt(3.0), 21)
    height = np.concatenate([-height, height])
    line = np.stack([np.full(42, 2.0), height], axis=1)
    for boundary in np.concatenate([arc, line]):
        assert np.linalg.norm(points - boundary, axis=1).min() < 0.02


def test_reach_table_encloses_every_posture():
    rng = np.random.default_rng(2)
    for arm in (table_1(), load_arm('paredis_table_3'), load_arm('paredis_table_2')):
        problem = prepare(arm, 'position', 1)
        for row in problem.table[:: len(problem.table) // 25]:
            q = rng.uniform(arm.lower, arm.upper, (200, arm.n))
            q[:, problem.combos[int(row[0]), 0]] = row[1]
            offset = fk(arm, q)[1] - row[2:5]
            height = offset @ row[5:8]
            radius = np.sqrt(np.maximum((offset**2).sum(axis=1) - height**2, 0.0))
            assert (row[8] <= height).all() and (height <= row[9]).all()
            assert (row[10] <= radius).all() and (radius <= row[11]).all()


def test_the_smallest_scale_of_a_template_puts_a_point_on_its_boundary():
    points = np.random.default_rng(4).normal(size=(6, 3))
    scale = smallest_scale(points)
    assert in_template(points, scale * (1 + 1e-9)).all()
    assert not in_template(points, scale * (1 - 1e-6)).all()
    arm = cover(points, clearance=0.02).chain()
    answers = query(arm, points, settings=FtwsSettings(intervals=False))
    assert all(answer.verdict is Verdict.MEMBER for answer in answers)


def test_operating_limits_make_lost_points_members():
    arm = planar(1.0, 1.0, 1.0)
    points = np.array([[1.5, 0.0, 0.0], [1.4, 0.3, 0.0]])
    found = find_operating_limits(arm, points)
    assert found.proved and found.chain is not None
    limit = np.arccos((1.0 + 1.5**2 - 4.0) / 3.0)
    low, high = found.limits['joint_1']
    turn = np.arctan2(0.3, 1.4)
    radius = np.hypot(1.4, 0.3)
    other = np.arccos((1.0 + radius**2 - 4.0) / (2.0 * radius))
    assert low == pytest.approx(max(-limit, turn - other), abs=8e-3)
    assert high == pytest.approx(min(limit, turn + other), abs=8e-3)


def test_operating_limits_that_do_not_exist_name_the_joint():
    found = find_operating_limits(planar(1.0, 0.1), np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    assert found.chain is None and not found.proved
    assert found.limits['joint_1'] is None and 'joint_1' in found.reason


def test_intersection_of_intervals():
    assert intersect([(0.0, 2.0), (3.0, 4.0)], [(1.0, 3.5)]) == [(1.0, 2.0), (3.0, 3.5)]
    assert intersect([(0.0, 1.0)], [(1.0, 2.0)]) == []


def test_limits_command_writes_arm_and_moveit_files(tmp_path, capsys):
    task = tmp_path / 'task.yaml'
    task.write_text('name: t\ngoals:\n  - {position: [1.5, 0.0, 0.0]}\n')
    output, moveit = tmp_path / 'arm.yaml', tmp_path / 'joint_limits.yaml'
    options = ['--output', str(output), '--moveit', str(moveit)]
    assert main(['limits', 'planar_3r', str(task), *options]) == 0
    capsys.readouterr()
    assert main(['ftws', str(output), '--point', '1.5', '0', '0', '--json']) == 0
    assert json.loads(capsys.readouterr().out)['verdict'] == 'member'
    limits = yaml.safe_load(moveit.read_text())['joint_limits']
    assert list(limits) == ['joint_1', 'joint_2', 'joint_3']
    assert limits['joint_1']['max_position'] < 1.83


def test_limits_of_a_urdf_become_its_soft_limits(tmp_path, capsys):
    task = tmp_path / 'task.yaml'
    task.write_text('name: t\ngoals:\n  - {position: [1.5, 0.0, 0.0]}\n')
    arm, output = tmp_path / 'arm.urdf', tmp_path / 'limited.urdf'
    arm.write_text(chain_to_urdf(planar(1.0, 1.0, 1.0)))
    assert main(['limits', str(arm), str(task), '--output', str(output)]) == 0
    capsys.readouterr()
    limited = load_arm(str(output))
    assert limited.joints[0].upper == pytest.approx(np.pi)
    assert 1.0 < limited.joints[0].operating[1] < 1.83
    assert main(['ftws', str(output), '--point', '1.5', '0', '0', '--json']) == 0
    assert json.loads(capsys.readouterr().out)['verdict'] == 'member'
    assert main(['limits', str(arm), str(task), '--output', str(tmp_path / 'arm.yaml')]) == 2
    assert '.urdf' in capsys.readouterr().err
    assert not (tmp_path / 'arm.yaml').exists()


def test_the_panda_has_no_strict_members_but_operating_limits():
    arm = load_arm(
        'package://example-robot-data/robots/panda_description/urdf/panda.urdf',
        base='panda_link0',
        tip='panda_hand',
    )
    points = np.array([[0.45, 0.0, 0.4], [0.3, 0.3, 0.6]])
    for answer in query(arm, points):
        # Shoulder and wrist are spherical: their distance depends on joint 4 alone.
        assert answer.verdict is Verdict.NON_MEMBER
        assert answer.joints == ('panda_joint4',)
        assert 0.2 < answer.surviving_fraction['panda_joint4'] < 0.6
        assert answer.surviving_fraction['panda_joint1'] == 1.0
    assert find_operating_limits(arm, points).proved
