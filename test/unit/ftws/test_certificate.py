"""Certificates: confirmed as written, rejected when tampered with."""

import copy
import json
from dataclasses import replace

import numpy as np
import pytest

from ft_manip_ros.cli.main import main
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.certificate import certify, load_certificate, save_certificate, verify
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import Verdict
from unit.ftws.arms import planar, table_1

SETTINGS = FtwsSettings(intervals=False)


@pytest.fixture(scope='module')
def document():
    points = np.array([[1.0, 0.3, 0.0], [2.2, 0.0, 0.0]])
    return certify(planar(1.0, 1.0, 1.0, 1.0), points, settings=SETTINGS)[1]


def test_the_verifier_confirms_the_engine(document):
    assert [ok for ok, _ in verify(json.loads(json.dumps(document)))] == [True, True]


def test_spatial_and_pose_certificates_hold():
    _, spatial = certify(table_1(), np.array([[1.0, 0.0, 0.5]]), settings=SETTINGS)
    assert all(ok for ok, _ in verify(spatial))
    pose = np.array([[1.0, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0]])
    _, planar_pose = certify(planar(1.0, 1.0, 1.0, 1.0, 0.0), pose, mode='pose', settings=SETTINGS)
    assert planar_pose['goals'][0]['verdict'] == 'member'
    assert all(ok for ok, _ in verify(planar_pose))


def test_the_points_of_eq_11_are_confirmed():
    points = np.array([[0.5, 0.0, 0.5], [0.0, 0.5, 0.25], [0.75, 0.0, 0.5]])
    results, eq_11 = certify(load_arm('paredis_table_3'), points, settings=SETTINGS)
    assert [result.verdict for result in results] == [Verdict.MEMBER] * 3
    assert all(ok for ok, _ in verify(eq_11))


def test_proofs_beside_joint_limits_are_confirmed():
    points = np.random.default_rng(3).uniform(-1.5, 1.5, (6, 3))
    results, limited = certify(table_1(limit_deg=170.0), points, settings=SETTINGS)
    assert len({result.verdict for result in results}) > 1
    assert all(ok for ok, _ in verify(limited))


def test_a_missing_piece_is_found(document):
    broken = copy.deepcopy(document)
    del broken['goals'][0]['pieces'][3]
    ok, text = next(verify(broken))
    assert not ok and 'covered by no proof' in text


def test_a_wrong_verdict_is_found(document):
    broken = copy.deepcopy(document)
    broken['goals'][1]['point'] = [1.0, 0.3, 0.0]  # a member, called a non-member
    broken['goals'][0]['point'] = [2.5, 0.0, 0.0]  # a non-member, called a member
    assert [ok for ok, _ in verify(broken)] == [False, False]


def test_an_arm_with_other_limits_is_found(document):
    broken = copy.deepcopy(document)
    for joint in broken['arm']['joints']:
        joint['lower'], joint['upper'] = -1.0, 1.0
    ok, _ = next(verify(broken))
    assert not ok


def short_of_two(radius=0.0):
    """Planar 6R, any two joints frozen within a quarter of a radian: a small proof of order 2."""
    arm = planar(*[1.0] * 6)
    joints = tuple(replace(j, operating_lower=-0.25, operating_upper=0.25) for j in arm.joints)
    settings = replace(SETTINGS, slab=0.1, restarts=30, radius=radius)
    point = np.array([[2.0, 1.0, 0.0]])
    return certify(replace(arm, joints=joints), point, order=2, settings=settings)[1]


def test_two_failures_at_once_are_confirmed_with_a_disc_of_goals():
    proof = json.loads(json.dumps(short_of_two(radius=0.01)))
    assert proof['goals'][0]['radius'] == 0.01
    ((ok, text),) = verify(proof)
    assert ok and 'disc of 0.01 m' in text
    proof['goals'][0]['radius'] = 0.5
    ((ok, text),) = verify(proof)
    assert not ok and 'covered by no proof' in text


def test_a_gap_about_two_angles_is_found():
    proof = short_of_two()
    assert [ok for ok, _ in verify(proof)] == [True]
    goal = proof['goals'][0]
    goal['pieces'] = [
        piece
        for piece in goal['pieces']
        if piece['joints'] != ['joint_3', 'joint_5']
        or abs(piece['posture'][2]) > piece['half'][0]
        or abs(piece['posture'][4]) > piece['half'][1]
    ]
    ((ok, text),) = verify(proof)
    assert not ok and text.startswith('member: joint_3, joint_5 at')


def test_postures_of_another_turn_are_as_good(document):
    turned = copy.deepcopy(document)
    for piece in turned['goals'][0]['pieces'][::2]:
        piece['posture'] = [angle + 2.0 * np.pi for angle in piece['posture']]
    assert next(verify(turned))[0]


@pytest.mark.parametrize('half', [[-0.1], [float('nan')]])
def test_a_piece_of_no_size_is_bad_input(document, half):
    broken = copy.deepcopy(document)
    broken['goals'][0]['pieces'][0]['half'] = half
    with pytest.raises(InputError, match=r'goals\[0\]'):
        next(verify(broken))


def test_a_ball_larger_than_the_proved_loss_is_rejected(document):
    broken = copy.deepcopy(document)
    broken['goals'][1]['radius'] = 0.5  # the point is 0.2 m beyond the disc of radius 2
    assert not list(verify(broken))[1][0]


def test_command_line_round_trip(tmp_path, capsys):
    path = tmp_path / 'proof.json'
    points = ['--point', '1', '0.2', '0', '--point', '3', '0', '0']
    assert main(['ftws', 'planar_4r', *points, '--certificate', str(path), '--json']) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [row['verdict'] for row in rows] == ['member', 'non_member']
    assert main(['verify', str(path), '--arm', 'planar_4r']) == 0
    assert main(['verify', str(path), '--arm', 'planar_3r']) == 2
    document = load_certificate(path)
    pieces = document['goals'][0]['pieces']
    document['goals'][0]['pieces'] = [p for p in pieces if p['joints'] != ['joint_2']]
    save_certificate(document, path)
    assert main(['verify', str(path)]) == 1


@pytest.mark.parametrize('text', ['not json', '{}', '{"format": "something"}'])
def test_files_that_are_no_certificates(tmp_path, text):
    path = tmp_path / 'file.json'
    path.write_text(text)
    with pytest.raises(InputError):
        load_certificate(path)
