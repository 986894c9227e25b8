"""Certificates of volumes: confirmed as written, rejected when tampered with."""

import copy

import numpy as np
import pytest

from ft_manip_ros.core.arm_file import load_dh
from ft_manip_ros.core.design.certificate import certify_design
from ft_manip_ros.core.ftws.certificate import load_certificate, save_certificate, verify
from ft_manip_ros.core.ftws.verifier import NotConfirmedError, check_region
from ft_manip_ros.core.ftws.verifier_arm import Arm
from ft_manip_ros.core.goal import Goal, Task
from ft_manip_ros.core.region import Box, Sphere

TASK = Task(
    'volumes',
    (
        Goal(np.array([0.5, 0.0, 0.5]), id='point'),
        Goal(np.array([0.5, 0.02, 0.5]), id='box', region=Box((0.012, 0.006, 0.006))),
        Goal(np.array([0.5, 0.0, 0.5]), id='ball', region=Sphere(0.006)),
    ),
)


@pytest.fixture(scope='module')
def document():
    (written,), outcomes = certify_design(load_dh('paredis_table_3').chain(), TASK, 1)
    assert [ok for ok, _ in outcomes] == [True] * 3, outcomes
    assert outcomes[1][1].startswith('box: the box of 0.012 x 0.006 x 0.006 m is covered by')
    return written


def volumes(document):
    return list(verify(document))[len(document['goals']) :]


def volume(document):
    """Check the first volume alone: the goals were confirmed with the fixture."""
    arm = Arm(document['arm'], document['mode'], 1e-6, 1e-6)
    return check_region(
        arm, document['regions'][0], document['goals'], [True] * len(document['goals'])
    )


def test_volumes_are_confirmed_whole(document, tmp_path):
    save_certificate(document, tmp_path / 'proof.json')
    again = volumes(load_certificate(tmp_path / 'proof.json'))
    assert [ok for ok, _ in again] == [True, True]
    assert 'all of the sphere: covered by' in again[1][1]


def drop_cell(document):
    del document['regions'][0]['cells'][-1]


def grow_volume(document):
    document['regions'][0]['half'][2] += 0.001


def grow_cell(document):
    document['regions'][0]['cells'][0]['half'][0] += 0.001


def shrink_ball(document):
    document['goals'][document['regions'][0]['cells'][0]['goal']]['radius'] *= 0.9


def other_goal(document):
    document['regions'][0]['cells'][0]['goal'] = 10_000


def other_order(document):
    document['regions'][0]['order'] = 2


@pytest.mark.parametrize(
    ('change', 'word'),
    [
        (drop_cell, 'is in no confirmed ball'),
        (grow_volume, 'is in no confirmed ball'),
        (grow_cell, 'sticks out of its ball'),
        (shrink_ball, 'sticks out of its ball'),
        (other_goal, 'is no confirmed member'),
        (other_order, 'of another order'),
    ],
)
def test_a_tampered_volume_is_rejected(document, change, word):
    broken = copy.deepcopy(document)
    change(broken)
    assert volume(document).startswith('covered by')
    with pytest.raises(NotConfirmedError, match=word):
        volume(broken)


def test_volumes_of_a_stopped_proof_are_not_confirmed():
    chain = load_dh('paredis_table_3').chain()
    documents, outcomes = certify_design(chain, TASK, 1, should_stop=lambda: True)
    assert documents == []
    assert [ok for ok, _ in outcomes] == [False] * 3
