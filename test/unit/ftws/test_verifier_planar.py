"""Certificates by closed form: confirmed as written, refused where they do not apply or lie."""

import copy
import json
from dataclasses import replace

import numpy as np
import pytest

from ft_manip_ros.cli.main import main
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.certificate import certify, load_certificate, verify
from ft_manip_ros.core.ftws.settings import FtwsSettings
from unit.ftws.arms import planar
from unit.ftws.test_planar_verdict import at_radius, facing_anywhere

MEMBER, LOST = [1.0, 0.5, 0.0], [2.4, 0.0, 0.0]


@pytest.fixture(scope='module')
def proof():
    points = np.array([MEMBER, LOST])
    return json.loads(json.dumps(certify(planar(*[1.0] * 6), points, order=2)[1]))


@pytest.fixture
def forged(proof):
    return copy.deepcopy(proof)


def rejection(document, goal=0):
    confirmed, text = list(verify(document))[goal]
    assert not confirmed
    return text


def test_both_verdicts_are_confirmed_and_need_no_pieces(proof):
    assert [ok for ok, _ in verify(proof)] == [True, True]
    member, lost = proof['goals']
    assert member['kind'] == lost['kind'] == 'planar_closed_form'
    assert 'pieces' not in member
    assert member['slack'] == pytest.approx(2.0 - np.hypot(1.0, 0.5), abs=1e-9)


def test_random_arms_of_order_2_and_3_are_confirmed():
    rng = np.random.default_rng(8)
    kinds = set()
    for order in (2, 3):
        for _ in range(20):
            lengths = rng.uniform(0.2, 1.0, 2 * order + 3) * (rng.random(2 * order + 3) > 0.1)
            arm = facing_anywhere(rng, lengths)
            points = np.array([at_radius(arm, rng, r) for r in rng.uniform(0.0, 2.5, 4)])
            _, document = certify(arm, points, order=order)
            for goal, (ok, text) in zip(document['goals'], verify(document), strict=True):
                assert ok, text
                kinds.add(goal['verdict'])
    assert kinds == {'member', 'non_member'}


def test_poses_of_order_2_are_confirmed_with_their_balls():
    rng = np.random.default_rng(9)
    kinds = set()
    for radius in (0.0, 0.05):
        poses = np.zeros((20, 7))
        poses[:, :2] = rng.uniform(-1.5, 1.5, (20, 2))
        turn = rng.uniform(-np.pi, np.pi, 20)
        poses[:, 5], poses[:, 6] = np.sin(turn / 2), np.cos(turn / 2)
        settings = FtwsSettings(radius=radius)
        arm = planar(*[1.0] * 6, 0.3)
        _, document = certify(arm, poses, order=2, mode='pose', settings=settings)
        kinds |= {goal['verdict'] for goal in document['goals']}
        assert all(ok for ok, _ in verify(document))
    assert {'member', 'non_member'} <= kinds


def test_a_disc_of_goals_is_confirmed_and_a_larger_one_is_not():
    settings = FtwsSettings(radius=0.8)
    _, document = certify(planar(*[1.0] * 6), np.array([MEMBER]), order=2, settings=settings)
    ((ok, text),) = verify(document)
    assert ok and 'disc of 0.8 m' in text
    document['goals'][0]['radius'] = 0.9
    assert 'miss it by' in rejection(document)


@pytest.mark.parametrize(
    ('key', 'value', 'text'),
    [
        ('lower', -3.0, 'limits'),
        ('upper', 3.0, 'limits'),
        ('prismatic', True, 'slides'),
        ('lower', float('nan'), 'limits'),
    ],
)
def test_arms_with_limits_or_slides_are_refused(forged, key, value, text):
    forged['arm']['joints'][3][key] = value
    assert text in rejection(forged, 0)
    assert text in rejection(forged, 1)


@pytest.mark.parametrize('tilt', [1e-6, 0.3])
def test_axes_that_are_not_parallel_are_refused(forged, tilt):
    c, s = np.cos(tilt), np.sin(tilt)
    forged['arm']['rotations'][2] = [[1, 0, 0], [0, c, -s], [0, s, c]]
    assert 'parallel' in rejection(forged, 0)
    assert 'parallel' in rejection(forged, 1)


def test_placements_that_stretch_are_refused(forged):
    forged['arm']['rotations'][2] = (1.01 * np.eye(3)).tolist()
    assert 'no rotation' in rejection(forged)


@pytest.mark.parametrize('value', [0.9, -0.1, float('nan'), float('inf')])
def test_a_wrong_slack_is_refused(forged, value):
    forged['goals'][0]['slack'] = value
    assert 'slack' in rejection(forged)


@pytest.mark.parametrize('value', [0.41, float('nan')])
def test_a_wrong_residual_is_refused(forged, value):
    forged['goals'][1]['residual'] = value
    assert 'is proved, not' in rejection(forged, 1)


def test_swapped_verdicts_are_refused(forged):
    member, lost = forged['goals']
    member['point'], lost['point'] = lost['point'], member['point']
    assert 'miss it by' in rejection(forged, 0)
    assert 'is proved' in rejection(forged, 1)
    lost['verdict'], lost['slack'] = 'member', 0.1
    lost['point'] = LOST
    assert 'miss it by' in rejection(forged, 1)


def test_a_witness_that_loses_nothing_is_refused(forged):
    forged['goals'][1]['angles'] = [0.3, 0.4]
    assert 'is proved' in rejection(forged, 1)


@pytest.mark.parametrize(('low', 'high'), [(-0.5, 0.5), (-3.0, 3.0)])
def test_a_witness_beyond_the_operating_limits_is_refused(forged, low, high):
    for joint in forged['arm']['joints']:
        joint['operating'] = [low, high]
    forged['goals'][1]['angles'] = [3.1, 0.0]
    assert 'cannot freeze' in rejection(forged, 1)


def test_a_joint_named_twice_is_refused(forged):
    goal = forged['goals'][1]
    goal['joints'] = [goal['joints'][0]] * 2
    assert 'are not 2 joints' in rejection(forged, 1)


@pytest.mark.parametrize('order', [0, 6, 7])
def test_an_impossible_order_is_refused(forged, order):
    forged['goals'][0]['order'] = order
    assert 'cannot fail' in rejection(forged)


def test_a_higher_order_than_was_proved_is_refused(forged):
    forged['goals'][0]['order'] = 3
    assert 'miss it by' in rejection(forged)


def test_a_shorter_link_is_found(forged):
    forged['arm']['translations'][4] = [0.2, 0.0, 0.0]
    forged['goals'][0]['point'] = [1.9, 0.0, 0.0]
    assert 'miss it by' in rejection(forged)


def test_numbers_that_are_none_are_refused(forged):
    forged['arm']['translations'][4] = [float('nan'), 0.0, 0.0]
    assert 'finite' in rejection(forged, 0)
    assert 'finite' in rejection(forged, 1)


def test_a_goal_off_the_plane_is_refused(forged):
    forged['goals'][0]['point'] = [1.0, 0.5, 0.01]
    assert 'off the plane' in rejection(forged)


def test_an_unknown_kind_is_refused(forged):
    forged['goals'][0]['kind'] = 'belief'
    assert 'belief' in rejection(forged)


def test_the_closed_form_is_no_covering_and_no_slack_is_malformed(forged):
    del forged['goals'][1]['kind']
    assert [ok for ok, _ in verify(forged)] == [True, True]  # refuted again, by boxes
    del forged['goals'][0]['slack']
    with pytest.raises(InputError, match=r'goals\[0\]'):
        next(verify(forged))
    forged['goals'][0]['kind'] = 'covering'
    with pytest.raises(InputError, match=r'goals\[0\]'):
        next(verify(forged))


def test_operating_limits_leave_members(proof):
    whole = planar(*[1.0] * 6)
    joints = tuple(replace(j, operating_lower=-2.0, operating_upper=2.0) for j in whole.joints)
    _, document = certify(replace(whole, joints=joints), np.array([MEMBER]), order=2)
    assert document['goals'][0]['kind'] == proof['goals'][0]['kind']
    assert [ok for ok, _ in verify(document)] == [True]


def test_command_line_round_trip(tmp_path, capsys):
    arm = tmp_path / 'planar_8r.yaml'
    rows = '\n'.join(f'  - {{name: joint_{i}, d: 0, a: 1, alpha: 0}}' for i in range(1, 9))
    arm.write_text(f'name: planar_8r\nconvention: standard_dh\njoints:\n{rows}\n')
    path = tmp_path / 'proof.json'
    points = ['--point', '1', '1.2', '0', '--point', '2.1', '0', '0']
    command = ['ftws', str(arm), *points, '--order', '3', '--certificate', str(path), '--json']
    assert main(command) == 0
    member, lost = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert (member['verdict'], lost['verdict']) == ('member', 'non_member')
    assert member['margin'] == pytest.approx(2.0 - np.hypot(1.0, 1.2), abs=1e-9)
    assert len(lost['joints']) == len(lost['angles']) == 3
    assert main(['verify', str(path), '--arm', str(arm)]) == 0
    assert load_certificate(path)['goals'][0]['kind'] == 'planar_closed_form'
