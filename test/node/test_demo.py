"""The demo as a user starts it: the whole story, all joints, a real robot, and its failures."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import psutil
import pytest

pytestmark = [pytest.mark.node, pytest.mark.timeout(600)]


def own_processes(output):
    """Every living process, whoever its parent, that was told about the demo's folder."""
    return [p for p in psutil.process_iter(['pid', 'cmdline']) if _is_told(p, output)]


def _is_told(process, output):
    return any(str(output) in part for part in process.info['cmdline'] or ())


def test_a_designed_arm_finishes_its_task_whatever_locks(start_node, tmp_path):
    output = tmp_path / 'story'
    demo = start_node('demo', '--seed', '5', '--headless', '--output', str(output))
    code = demo.wait(300.0)
    told = demo.output
    assert code == 0, told
    for step in (
        'designer      announces a proved 5-joint design',
        'p_1: member',
        'p_3: member',
        'not a member: with joint_',
        'LOCKS',
        'is LOCKED at',
        'finishes: all',
        'read back by rosbags and by mcap',
        '0 differences',
        'everything happened as told above',
    ):
        assert step in told, f'{step!r} is missing in:\n{told}'
    assert (output / 'demo.png').stat().st_size > 50_000
    assert (output / 'designed_arm.yaml').is_file()
    assert not own_processes(output)


def test_each_joint_of_table_3_may_lock(start_node, tmp_path):
    demo = start_node(
        'demo', '--arm', 'paredis_table_3', '--joint', 'all', '--seed', '8', '--headless',
        '--output', str(tmp_path / 'all'),
    )  # fmt: skip
    assert demo.wait(500.0) == 0, demo.output
    rows = demo.output.split('All runs')[1].splitlines()
    for k in range(1, 6):
        row = next(line for line in rows if line.strip().startswith(f'joint_{k} '))
        assert row.endswith('as promised')
        reached, of, left = row.split(' left')[0].split()[-3:]
        assert (reached, of) == (left, 'of')


def test_a_franka_panda_does_what_its_locked_elbow_allows(start_node, tmp_path):
    demo = start_node(
        'demo', '--arm', 'panda', '--joint', 'panda_joint4', '--seed', '3', '--headless',
        '--output', str(tmp_path / 'panda'),
    )  # fmt: skip
    assert demo.wait(300.0) == 0, demo.output
    told = demo.output
    assert 'not a member: with panda_joint4 locked at' in told
    assert 'panda_joint4 is LOCKED' in told
    assert 'reached within' in told
    # The far point asks for a straighter elbow than the one that locked.
    assert 'far is LOST' in told or 'far is UNDECIDED' in told


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_it_can_be_stopped_in_the_middle_and_leaves_nothing(start_node, tmp_path, number):
    output = tmp_path / 'stopped'
    demo = start_node('demo', '--arm', 'paredis_table_3', '--headless', '--output', str(output))
    demo.wait_for('task paredis_eq_11 published')
    assert demo.stop(number, timeout=15.0) == 130
    assert not demo.members()
    assert not own_processes(output)


def test_a_process_that_dies_is_named_and_the_story_fails(start_node, tmp_path):
    output = tmp_path / 'broken'
    demo = start_node(
        'demo', '--arm', 'paredis_table_3', '--seed', '1', '--headless', '--output', str(output)
    )
    demo.wait_for('the arm moves')
    children = psutil.Process(demo.pid).children(recursive=True)
    victim = next(c for c in children if 'ft_manip_ros.nodes.replanner' in c.cmdline())
    os.kill(victim.pid, signal.SIGKILL)
    assert demo.wait(60.0) == 1
    assert 'replanner ended with exit code -9' in demo.output
    assert not own_processes(output)


@pytest.mark.parametrize(
    ('arguments', 'complaint'),
    [
        (['--arm', 'paredis_table_3', '--joint', '9'], 'joints 1 to 5'),
        (['--arm', 'paredis_table_3', '--joint', 'wrist'], 'joint_1, joint_2'),
        (['--task', 'no_such_task'], 'paredis_eq_11'),
        (['--arm', 'no_such_arm'], 'paredis_table_3'),
        (['--speed', '3'], '--speed'),
    ],
)
def test_bad_options_are_named_before_anything_starts(start_node, tmp_path, arguments, complaint):
    demo = start_node('demo', '--output', str(tmp_path / 'out'), *arguments)
    assert demo.wait(60.0) == 2
    assert complaint in demo.output
    assert not (tmp_path / 'out' / 'logs').exists()


def test_an_output_with_a_bag_in_it_is_not_overwritten(start_node, tmp_path):
    bag = Path(tmp_path) / 'bag'
    bag.mkdir()
    (bag / 'metadata.yaml').write_text(json.dumps({}))
    demo = start_node('demo', '--output', str(tmp_path))
    assert demo.wait(60.0) == 2
    assert 'bag already' in demo.output
    assert list(bag.iterdir()) == [bag / 'metadata.yaml']
