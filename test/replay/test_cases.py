"""Every committed case replays to what was recorded and to its `expected.yaml`."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from ft_manip_ros.cli.main import main

CASES = Path(__file__).resolve().parents[2] / 'bags'
NAMES = sorted(path.parent.name for path in CASES.glob('*/expected.yaml'))


def test_there_are_cases() -> None:
    assert 'locked_joint' in NAMES


@pytest.mark.parametrize('name', NAMES)
def test_a_case_is_reproduced(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    code = main(['replay', str(CASES / name), '--check'])
    output = capsys.readouterr()
    assert code == 0, output.out + output.err
    assert 'digest ' in output.out


def test_a_case_that_is_not_as_expected_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case = tmp_path / 'case'
    shutil.copytree(CASES / 'locked_joint', case)
    expected = case / 'expected.yaml'
    text = expected.read_text()
    assert 'to: LOCKED' in text
    expected.write_text(text.replace('to: LOCKED', 'to: RUNAWAY'))
    assert main(['replay', str(case), '--check']) == 1
    assert 'not as expected' in capsys.readouterr().out
