"""CSV files, the command `ftmanip detect`, and the evaluation."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ft_manip_ros.cli.main import main
from ft_manip_ros.core.detection.evaluate import evaluate
from ft_manip_ros.core.detection.implant import KINDS, implant, moving_rows
from ft_manip_ros.core.detection.offline import detect
from ft_manip_ros.core.detection.recording import build_recording
from ft_manip_ros.core.detection.recording_csv import read_csv
from ft_manip_ros.core.detection.simulate import random_arm, simulate
from ft_manip_ros.core.detection.states import JointState
from ft_manip_ros.core.errors import InputError


def sines(duration=12.0, rate=100.0, lock=None):
    """Two joints that follow sines 20 ms late; the second may lock at a time."""
    times = np.arange(0.0, duration, 1.0 / rate)
    commands = np.stack((0.5 * np.sin(2 * times), 0.4 * np.sin(1.7 * times)), axis=1)
    late = times - 0.02
    positions = np.stack((0.5 * np.sin(2 * late), 0.4 * np.sin(1.7 * late)), axis=1)
    positions += 1e-5 * np.random.default_rng(0).standard_normal(positions.shape)
    if lock is not None:
        row = int(lock * rate)
        positions[row:, 1] = positions[row, 1]
    return build_recording('sines', ['a', 'b'], times, positions, commands=commands)


def write_csv(path, recording, rows=None):
    header = ['time', *(f'position.{n}' for n in recording.joints)]
    header += [f'command.{n}' for n in recording.joints]
    lines = [','.join(header)]
    for k, time in enumerate(recording.times):
        cells = [time, *recording.positions[k], *recording.commands[k]]
        lines.append(','.join(repr(float(cell)) for cell in cells))
    path.write_text('\n'.join(lines) + '\n')
    return path


def test_empty_cells_mean_not_in_this_sample(tmp_path):
    path = tmp_path / 'some.csv'
    path.write_text(
        'time,position.a,velocity.a,position.b,command.b\n'
        '0.0,1.0,0.5,2.0,3.0\n'
        '\n'
        '0.1,,,2.5,\n'
        '0.2,nan,,2.5,4.0\n'
    )
    recording = read_csv(path)
    assert recording.joints == ('a', 'b')
    assert recording.stamps.tolist() == [0, 100_000_000, 200_000_000]
    assert recording.present.tolist() == [[True, True], [False, True], [True, True]]
    assert np.isnan(recording.positions[:, 0]).tolist() == [False, True, True]
    assert recording.commands[:, 1].tolist() == [3.0, 3.0, 4.0]
    assert np.isnan(recording.commands[:, 0]).all()
    assert recording.velocities[0, 0] == 0.5


@pytest.mark.parametrize(
    ('text', 'complaint'),
    [
        ('', 'line 1: has no column time'),
        ('t,position.a\n', 'no column time'),
        ('time,a\n', 'no column position.NAME'),
        ('time,position.a,position.a\n', 'twice'),
        ('time,position.a,speed.a\n', "column 'speed.a': is none of"),
        ('time,position.a,command.b\n', "column 'command.b'"),
        ('time,position.a\n', 'no rows'),
        ('time,position.a\n0.0\n', 'line 2: has 1 cells; the header has 2'),
        ('time,position.a\n0.0,x\n', "column 'position.a' is 'x'; a number or nothing"),
        ('time,position.a\n0.0,1\nnan,1\n', 'line 3: time: is nan'),
    ],
)
def test_malformed_csv_names_line_and_column(tmp_path, capsys, text, complaint):
    path = tmp_path / 'bad.csv'
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_csv(path)
    assert complaint in str(caught.value)
    assert main(['detect', str(path), '--json']) == 2
    assert 'bad.csv' in capsys.readouterr().err


def test_detect_prints_one_object_an_edge_and_draws(tmp_path, capsys):
    recording = sines(lock=8.0)
    path = write_csv(tmp_path / 'sines.csv', recording)
    picture = tmp_path / 'out.png'
    assert main(['detect', str(path), '--json', '--plot', str(picture)]) == 0
    edges = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    keys = {'time', 'joint', 'state', 'angle', 'sigma', 'first_evidence', 'cause'}
    assert all(set(edge) == keys for edge in edges)
    locks = [edge for edge in edges if edge['state'] == 'LOCKED']
    assert [edge['joint'] for edge in locks] == ['b']
    (lock,) = locks
    assert 8.0 < lock['first_evidence'] <= lock['time'] < 8.3
    assert lock['angle'] == pytest.approx(recording.positions[-1, 1], abs=1e-9)
    assert 0.0 < lock['sigma'] < 1e-3
    assert picture.read_bytes().startswith(b'\x89PNG')
    assert main(['detect', str(path)]) == 0
    assert 'b                LOCKED' in capsys.readouterr().out


def test_detect_by_blocks_is_detect_one_by_one():
    from ft_manip_ros.core.detection.offline import Trace

    recording = sines(lock=6.0)
    trace = Trace.empty(recording.joints)
    _, blocks = detect(recording)
    _, single = detect(recording, trace=trace)
    assert [(e.stamp, e.report.name, e.report.state) for e in blocks] == [
        (e.stamp, e.report.name, e.report.state) for e in single
    ]
    assert len(trace.stamps) == len(recording.stamps)


def test_an_arm_gives_limits_and_drops_foreign_joints(tmp_path, capsys):
    recording = sines()
    path = write_csv(tmp_path / 'sines.csv', recording)
    assert main(['detect', str(path), '--arm', 'paredis_table_3']) == 2
    assert 'joint_1, joint_2' in capsys.readouterr().err
    assert main(['detect', str(path), '--exempt', 'b', '--sensitivity', '0']) == 2
    assert main(['detect', str(tmp_path / 'none.csv')]) == 2
    assert main(['detect']) == 2
    assert main(['detect', str(path), '--evaluate', str(tmp_path)]) == 2


@pytest.mark.parametrize('seed', range(6))
def test_simulated_arms_without_failure_raise_no_alarm(seed):
    rng = np.random.default_rng(seed)
    recording, truth = simulate(rng, random_arm(rng, n=4), 60.0)
    assert truth.shape == recording.positions.shape
    _, edges = detect(recording)
    assert {e.report.state for e in edges} <= {JointState.OK, JointState.IDLE, JointState.SUSPECT}


@pytest.mark.parametrize('kind', KINDS)
def test_implanted_faults_change_only_what_they_should(kind):
    recording, _ = simulate(
        np.random.default_rng(1), random_arm(np.random.default_rng(1), 3), 30.0
    )
    faulty, fault = implant(recording, kind, np.random.default_rng(2))
    rows = slice(0, fault.row)
    assert np.array_equal(faulty.positions[rows], recording.positions[rows], equal_nan=True)
    assert np.array_equal(faulty.commands, recording.commands, equal_nan=True)
    others = [j for j in range(3) if fault.joint not in (-1, j)]
    assert np.array_equal(faulty.positions[:, others], recording.positions[:, others])
    if kind == 'lock':
        assert np.ptp(faulty.positions[fault.row :, fault.joint]) == 0.0
        after = recording.commands[fault.row :, fault.joint]
        assert np.ptp(after) > np.deg2rad(1.0)
        assert fault.row in moving_rows(recording, fault.joint)


def test_the_evaluation_counts_what_it_implants():
    recording = sines(duration=20.0)
    result = evaluate([recording], trials=4, seed=0, kinds=('lock', 'stale', 'not a number'))
    assert result.passed
    assert [row.trials for row in result.kinds] == [4, 4, 4]
    assert [row.found for row in result.kinds] == [4, 4, 4]
    lock = result.kinds[0]
    assert all(late > bound for late, bound in zip(lock.latency, lock.bound, strict=True))
    assert max(lock.error) < 1e-4
    assert result.fixed.trials == 4
    assert 'sensitivity' in result.table()
    json.dumps(result.to_json())
    # A sensitivity that makes the monitor blind has to be noticed.
    loose = [point for point in result.roc if point.sensitivity > 1.0]
    assert all(point.rate <= 1.0 for point in loose)


def test_no_recordings_are_named(tmp_path, capsys):
    assert main(['detect', '--evaluate', str(tmp_path)]) == 2
    assert 'holds no recording' in capsys.readouterr().err
