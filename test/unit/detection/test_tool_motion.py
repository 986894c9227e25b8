"""The tool's motion tells a stuck encoder from a locked joint, and is never taken for more."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ft_manip_ros.cli.main import main
from ft_manip_ros.core.detection.monitor import FaultMonitor
from ft_manip_ros.core.detection.recording_csv import read_csv
from ft_manip_ros.core.detection.states import JointState
from ft_manip_ros.core.errors import InputError
from support.seen_tool import SeenArm

LEARNING = 6.0  # s in which the tool is seen to move with the arm
JOINTS = (0, 2, 4)


def healthy(arm, duration=LEARNING):
    arm.run(duration)
    assert not any(arm.found(arm.edges, joint) for joint in range(arm.chain.n))
    return arm


@pytest.mark.parametrize('joint', JOINTS)
@pytest.mark.parametrize('rate', [50.0, 250.0])
def test_a_stuck_encoder_is_a_sensor_fault_and_holds_its_last_good_angle(joint, rate):
    arm = healthy(SeenArm(rate=rate, tool_rate=50.0, seed=joint))
    reads = arm.stick(joint)
    edges = arm.run(4.0)
    (fault,) = arm.found(edges, joint)
    assert fault[1] == JointState.SENSOR
    assert 'the joint moves' in fault[2]
    assert not any(arm.found(edges, other) for other in range(arm.chain.n) if other != joint)
    report = arm.monitor.states()[joint]
    assert report.state == JointState.SENSOR
    assert report.position == pytest.approx(reads, abs=5.0 * arm.encoder_noise)
    assert math.isnan(report.frozen_position)


@pytest.mark.parametrize('joint', JOINTS)
def test_a_locked_joint_is_locked_when_the_tool_stands_too_as_soon_as_its_pose_comes(joint):
    blind = healthy(SeenArm(tool_rate=0.0, seed=joint))
    blind.lock(joint)
    (alone,) = blind.found(blind.run(4.0), joint)
    arm = healthy(SeenArm(seed=joint))
    stands = arm.lock(joint)
    (found,) = arm.found(arm.run(4.0), joint)
    assert found[1] == alone[1] == JointState.LOCKED
    assert 'the tool stands as well' in found[2]
    assert arm.monitor.frozen()[arm.names[joint]] == pytest.approx(stands, abs=1e-4)
    # A pose of that moment is seen `delay` and comes `late` later, up to a period after that;
    # the last one and the samples' own period are what the tool's own clock adds.
    assert found[0] <= alone[0] + arm.delay + arm.late + 2.0 / 50.0 + arm.period


def test_offset_delay_and_noise_of_the_tool_are_learned():
    arm = healthy(SeenArm(noise=1e-3, delay=0.052), 12.0)
    model = arm.monitor.tool.model
    assert model.believed
    np.testing.assert_allclose(model.offset, arm.offset, atol=2e-3)
    assert model.delay == pytest.approx(arm.delay, abs=5e-3)
    assert model.noise == pytest.approx(arm.noise, rel=0.5)
    assert 'moves with the arm' in arm.monitor.tool.text


@pytest.mark.parametrize(
    'spoilt',
    [
        {'turn': Rotation.from_euler('z', 90.0, degrees=True).as_matrix()},
        {'delay': 0.8},
        {'noise': 0.3},
        {'late': 0.6},
        {'tool_rate': 5.0},
    ],
    ids=['turned frame', 'far too old', 'noisy', 'late', 'rare'],
)
def test_a_tool_that_cannot_tell_changes_nothing(spoilt):
    blind = healthy(SeenArm(tool_rate=0.0))
    arm = healthy(SeenArm(**spoilt))
    for each in (blind, arm):
        each.stick(2)
    alone = blind.found(blind.run(3.0), 2)
    assert arm.found(arm.run(3.0), 2)[0][:2] == alone[0][:2]
    assert alone[0][1] == JointState.LOCKED


def test_a_tool_that_is_lost_from_sight_changes_nothing_but_what_was_seen_stays():
    arm = healthy(SeenArm())
    arm.every = 0
    arm.run(1.0)
    arm.stick(0)
    assert arm.found(arm.run(2.0), 0)[0][1] == JointState.LOCKED
    arm = healthy(SeenArm())
    arm.stick(0)
    assert arm.found(arm.run(1.0), 0)[0][1] == JointState.SENSOR
    arm.every = 0
    assert not arm.found(arm.run(5.0), 0)
    assert arm.monitor.states()[0].state == JointState.SENSOR


def test_a_stuck_encoder_that_works_again_has_to_show_where_it_is():
    arm = healthy(SeenArm())
    stood = arm.stick(0)
    arm.run(1.0)
    # Its counter counts on from where it stuck.
    arm.slipped[0] = stood - arm.truth(arm.time)[0]
    del arm.stuck[0]
    states = [e.report.state for e in arm.run(4.0) if e.report.name == arm.names[0]]
    assert states[0] == JointState.PROVING
    assert states[-1] == JointState.OK
    assert JointState.LOCKED not in states


def test_two_suspects_whose_motions_the_tool_cannot_tell_apart_stay_locked_and_it_says_so():
    # Stretched out, all joints of a planar arm move the tool the same way.
    arm = SeenArm('planar_4r', offset=(0.0, 0.0, 0.0), noise=2e-4)
    arm.middle[:] = 0.0
    arm.amplitude[:] = (0.3, 0.1, 0.1, 0.1)
    arm.pace[:] = (2.0, 3.0, 3.0, 3.0)
    arm.phase[:] = (0.0, -0.3, -0.3, -0.3)
    healthy(arm, 2.0 * np.pi)
    arm.stick(1)
    arm.stick(2)
    edges = arm.run(2.0)
    for joint in (1, 2):
        (fault,) = arm.found(edges, joint)
        assert fault[1] == JointState.LOCKED
        assert 'it is unclear which joint moves it' in fault[2]


def test_two_encoders_that_stick_at_once_are_told_from_two_locks():
    arm = healthy(SeenArm(seed=3))
    arm.stick(0)
    arm.stick(2)
    edges = arm.run(4.0)
    assert {arm.found(edges, joint)[0][1] for joint in (0, 2)} == {JointState.SENSOR}
    arm = healthy(SeenArm(seed=3))
    arm.lock(0)
    arm.lock(2)
    edges = arm.run(4.0)
    assert {arm.found(edges, joint)[0][1] for joint in (0, 2)} == {JointState.LOCKED}


def test_single_wild_poses_make_no_lock_a_sensor_fault():
    arm = SeenArm(seed=1)
    wild = np.random.default_rng(5)

    def spoil(position):
        return position + (wild.normal(0.0, 0.3, 3) if wild.random() < 0.1 else 0.0)

    arm.change = spoil
    healthy(arm, 15.0)
    arm.lock(1)
    assert {fault[1] for fault in arm.found(arm.run(4.0), 1)} == {JointState.LOCKED}


def test_effort_beyond_any_seen_asks_for_more_poses():
    delays = {}
    for strains in (False, True):

        def effort(arm, strains=strains):
            high = 0 in arm.stuck and strains
            return np.where(np.arange(arm.chain.n) == 0, 30.0 if high else 5.0, 5.0)

        arm = healthy(SeenArm(seed=2, effort=effort))
        arm.stick(0)
        since = arm.time
        (fault,) = arm.found(arm.run(2.0), 0)
        assert fault[1] == JointState.SENSOR
        delays[strains] = fault[0] - since
    assert delays[True] > delays[False]


def test_poses_that_are_nonsense_are_refused_and_change_nothing():
    arm = healthy(SeenArm(), 2.0)
    stamp = arm.stamp(arm.time)
    for position in ((math.nan, 0.0, 0.0), (0.0, math.inf, 0.0), (0.0, 0.0)):
        with pytest.raises(InputError, match='finite x, y, z'):
            arm.feed.tool_pose(stamp, stamp, 'base_link', position)
    with pytest.raises(InputError, match="is 'camera'; 'base_link'"):
        arm.feed.tool_pose(stamp, stamp, 'camera', (0.0, 0.0, 0.0))
    with pytest.raises(InputError, match='ahead of the joint states'):
        arm.feed.tool_pose(stamp + 5 * 10**9, stamp, '', (0.0, 0.0, 0.0))
    with pytest.raises(InputError, match='needs a monitor'):
        FaultMonitor(['a']).tool_pose(0, np.zeros(3))
    with pytest.raises(InputError, match="'joint_1' is not watched"):
        FaultMonitor(['a'], chain=arm.chain)
    healthy(arm)
    assert arm.monitor.tool.model.believed


def test_detect_reads_the_tool_from_a_csv(tmp_path, capsys):
    arm = healthy(SeenArm(late=0.0))
    arm.stick(1)
    expected = [(e.report.name, e.report.state.name) for e in (*arm.edges, *arm.run(1.5))]
    header = ['time', *(f'position.{name}' for name in arm.names)]
    header += [*(f'command.{name}' for name in arm.names), 'tool.x', 'tool.y', 'tool.z']
    lines = [','.join(header)]
    for t, reading, command, tool in arm.rows:
        cells = [repr(float(x)) for x in (t + 100.0, *reading, *command)]
        cells += ['' if math.isnan(x) else repr(float(x)) for x in tool]
        lines.append(','.join(cells))
    path = tmp_path / 'seen.csv'
    path.write_text('\n'.join(lines) + '\n')
    assert main(['detect', str(path), '--arm', 'paredis_table_3', '--json']) == 0
    edges = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [(edge['joint'], edge['state']) for edge in edges] == expected
    assert ('joint_2', 'SENSOR') in expected
    # Without the arm nothing is made of where its tool is.
    assert main(['detect', str(path), '--json']) == 0
    assert '"LOCKED"' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('text', 'complaint'),
    [
        ('time,position.a,tool.x\n0,0,0\n', 'has some of tool.x, tool.y, tool.z only'),
        ('time,position.a,tool.x,tool.y,tool.z\n0,0,1,,2\n', 'line 2: fills some of tool.x'),
    ],
)
def test_half_a_position_is_refused(tmp_path, text, complaint):
    path = tmp_path / 'half.csv'
    path.write_text(text)
    with pytest.raises(InputError, match=complaint):
        read_csv(path)
