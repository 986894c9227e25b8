"""`ftmanip design` as a user runs it: output, JSON, bad input, Ctrl-C, kill and resume."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from ft_manip_ros.cli.main import main
from ft_manip_ros.core.arm_file import load_dh
from ft_manip_ros.core.design.certificate import certify_design
from ft_manip_ros.core.ftws.certificate import load_certificate, verify
from ft_manip_ros.core.goal import Goal, Task

COMMAND = [sys.executable, '-m', 'ft_manip_ros.cli.main', 'design']
HOPELESS = ['paredis_eq_11', '--dof', '3']


def start(*arguments):
    return subprocess.Popen(
        [*COMMAND, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
    )


def run(*arguments, timeout=200):
    process = start(*arguments)
    out, err = process.communicate(timeout=timeout)
    return process.returncode, out, err


def test_a_design_is_written_printed_and_pictured(tmp_path):
    arm, picture, proofs = (tmp_path / name for name in ('arm.yaml', 'arm.png', 'proofs.json'))
    code, out, err = run(
        'paredis_eq_11',
        '--seed',
        2,
        '--workers',
        2,
        '--output',
        arm,
        '--report',
        picture,
        '--certificate',
        proofs,
        '--json',
    )
    assert code == 0, err
    answer = json.loads(out)
    assert answer['proved']
    assert answer['penalty'] == 0.0
    assert [verdict['verdict'] for verdict in answer['verdicts']] == ['member'] * 3
    table = load_dh(arm)
    np.testing.assert_array_equal(table.d, answer['d'])
    np.testing.assert_array_equal(table.alpha, answer['alpha'])
    assert picture.read_bytes().startswith(b'\x89PNG')
    # The exit code says that the independent verifier confirmed every proof; ask it again.
    outcomes = list(verify(load_certificate(proofs)))
    assert [confirmed for confirmed, _ in outcomes] == [True] * 3
    assert len(list(tmp_path.iterdir())) == 3


def test_what_is_no_member_gets_no_confirmed_certificate():
    goals = (Goal(np.array([0.5, 0.0, 0.5])), Goal(np.array([2.6, 0.0, 0.5]), id='far'))
    documents, outcomes = certify_design(
        load_dh('paredis_table_3').chain(), Task('far', goals), order=1
    )
    assert [confirmed for confirmed, _ in outcomes] == [True, False]
    assert 'far' in outcomes[1][1]
    assert [goal['verdict'] for goal in documents[0]['goals']] == ['member', 'non_member']


def test_no_proof_no_success(tmp_path):
    code, out, _ = run(*HOPELESS, '--max-segments', 2)
    assert code == 1
    assert 'NOT PROVED' in out


def test_ctrl_c_keeps_the_best(tmp_path):
    arm = tmp_path / 'arm.yaml'
    process = start(*HOPELESS, '--time-budget', 300, '--output', arm)
    checkpoint = tmp_path / 'arm.yaml.checkpoint'
    deadline = time.monotonic() + 100
    while not checkpoint.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 1
    assert 'stopped on request' in out
    assert 'best design is kept' in err
    assert load_dh(arm).n == 3


def test_a_killed_search_is_taken_up_again(tmp_path):
    arm = tmp_path / 'arm.yaml'
    budget = ['--max-segments', '60', '--json']
    code, out, _ = run(*HOPELESS, *budget)
    assert code == 1
    expected = json.loads(out)
    process = start(*HOPELESS, *budget, '--output', arm)
    checkpoint = tmp_path / 'arm.yaml.checkpoint'
    deadline = time.monotonic() + 100
    while not checkpoint.exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    process.kill()
    process.communicate()
    assert json.loads(checkpoint.read_text())['next'] < [15, 0]
    assert not arm.exists()
    code, out, err = run(*HOPELESS, *budget, '--output', arm, '--resume', '--workers', 2)
    assert code == 1, err
    found = json.loads(out)
    for key in ('penalty', 'd', 'a', 'alpha', 'iterations', 'evaluations'):
        assert found[key] == expected[key]


@pytest.mark.parametrize(
    ('arguments', 'word'),
    [
        (['no_such_task'], 'no_such_task'),
        (['paredis_eq_11', '--dof', '1'], 'dof'),
        (['paredis_eq_11', '--order', '0'], 'order'),
        (['paredis_eq_11', '--limits-deg', '10', '-10'], 'limits'),
        (['paredis_eq_11', '--limits-deg', 'nan', '10'], 'limits'),
        (['paredis_eq_11', '--bound', 'a', '0', 'wide'], 'wide'),
        (['paredis_eq_11', '--bound', 'a', '0', 'nan'], 'bounds.a'),
        (['paredis_eq_11', '--fix', 'beta_1', '0'], 'beta_1'),
        (['paredis_eq_11', '--max-length', '-1'], 'max_length'),
        (['paredis_eq_11', '--time-budget', '0'], 'time_budget'),
        (['paredis_eq_11', '--workers', '0'], 'workers'),
        (['paredis_eq_11', '--resume'], '--checkpoint'),
        (['paredis_eq_11', '--output', '/no/such/folder/arm.yaml'], 'folder'),
        (['paredis_eq_11', '--method', 'guess'], 'paredis_1994'),
    ],
)
def test_bad_input_is_named(arguments, word, capsys):
    try:
        code = main(['design', *arguments])
    except SystemExit as stopped:
        code = stopped.code
    out, err = capsys.readouterr()
    assert code == 2
    assert word in err
    assert 'Traceback' not in err
    assert out == ''


def test_an_existing_file_is_not_overwritten(tmp_path, capsys):
    arm = tmp_path / 'arm.yaml'
    arm.write_text('mine')
    assert main(['design', 'paredis_eq_11', '--output', str(arm)]) == 2
    assert '--force' in capsys.readouterr().err
    assert arm.read_text() == 'mine'
