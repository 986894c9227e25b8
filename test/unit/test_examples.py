"""The examples run, and say what their comments promise."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.verdict import Verdict
from ft_manip_ros.core.task_file import load_task

EXAMPLES = Path(__file__).resolve().parents[2] / 'examples'


@pytest.fixture
def run(monkeypatch, capsys):
    """Run an example as a script; returns what it printed."""

    def run(name: str, *arguments: str) -> str:
        monkeypatch.setattr(sys, 'argv', [name, *arguments])
        runpy.run_path(str(EXAMPLES / name), run_name='__main__')
        return capsys.readouterr().out

    return run


def test_the_work_space_is_asked(run):
    told = run('ask_the_work_space.py')
    assert '(0.5, 0.1, 0.3): member' in told
    assert told.count(': non_member') == 2
    assert 'base locked at' in told
    assert told.index('every goal is a member') < told.index('wrist: -170.0 to 170.0 deg')


def test_an_arm_is_designed_and_written(run, tmp_path):
    file = tmp_path / 'arm.yaml'
    assert 'proved: all 4 goals' in run('design_an_arm.py', str(file))
    goals = load_task(EXAMPLES / 'inspection_task.yaml').goals
    points = np.array([goal.position for goal in goals])
    assert {answer.verdict for answer in query(load_arm(file), points)} == {Verdict.MEMBER}


def test_a_lock_is_survived(run):
    told = run('survive_a_lock.py')
    assert 'joint_3 is locked at' in told
    assert told.count('finishes: all 3 remaining goals are visited') == 2
    # The last words: how far the tool ends from the last goal.
    error = float(told.rpartition('the tool ends ')[2].split()[0])
    assert error < 0.5
