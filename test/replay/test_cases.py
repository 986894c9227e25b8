"""Every committed case replays to what was recorded and to its `expected.yaml`."""

from __future__ import annotations

from pathlib import Path

import pytest

from ft_manip_ros.cli.main import main

CASES = Path(__file__).resolve().parents[2] / 'bags'
NAMES = sorted(path.parent.name for path in CASES.glob('*/expected.yaml'))


def test_there_are_cases() -> None:
    assert 'locked_joint' in NAMES


@pytest.mark.parametrize('name', NAMES)
def test_a_case_is_reproduced(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    code = main(['replay', str(CASES / name / 'bag'), '--check'])
    output = capsys.readouterr()
    assert code == 0, output.out + output.err
    assert 'digest ' in output.out
