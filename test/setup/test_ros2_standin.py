"""The small `ros2` for machines without a ROS installation."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

STANDIN = Path(__file__).parents[2] / 'scripts' / 'standin' / 'ros2'


@pytest.fixture
def prefixes(tmp_path: Path) -> str:
    """Make two prefixes; the second overlays package `arm` of the first."""
    for prefix, packages in (('under', ('arm', 'base')), ('over', ('arm',))):
        for package in packages:
            marker = tmp_path / prefix / 'share/ament_index/resource_index/packages' / package
            marker.parent.mkdir(parents=True, exist_ok=True)
            marker.touch()
            program = tmp_path / prefix / 'lib' / package / 'talk'
            program.parent.mkdir(parents=True)
            program.write_text(f'#!/bin/sh\necho {prefix} {package}; printf "<%s>" "$@"\nexit 7\n')
            program.chmod(0o755)
            (program.parent / 'notes.txt').touch()
    return f'{tmp_path}/over:{tmp_path}/under'


def ros2(prefixes: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the stand-in."""
    return subprocess.run(
        [str(STANDIN), *arguments],
        env={'PATH': os.environ['PATH'], 'AMENT_PREFIX_PATH': prefixes},
        capture_output=True,
        text=True,
        check=False,
    )


def test_run_finds_the_overlay_and_passes_arguments_and_exit_code(prefixes: str) -> None:
    done = ros2(prefixes, 'run', 'arm', 'talk', 'one two', '--ros-args', '-p', 'a:=1')
    assert done.stdout == 'over arm\n<one two><--ros-args><-p><a:=1>'
    assert done.returncode == 7
    assert ros2(prefixes, 'run', 'base', 'talk').stdout.startswith('under base\n')


def test_what_is_not_there_is_named(prefixes: str) -> None:
    done = ros2(prefixes, 'run', 'arm', 'sing')
    assert done.returncode == 1
    assert done.stderr == "ros2: no executable 'sing' in package 'arm'; there are: talk \n"
    done = ros2(prefixes, 'run', 'leg', 'talk')
    assert done.returncode == 1
    assert "package 'leg' not found" in done.stderr


def test_packages(prefixes: str) -> None:
    assert ros2(prefixes, 'pkg', 'list').stdout == 'arm\nbase\n'
    assert ros2(prefixes, 'pkg', 'prefix', 'arm').stdout == f'{prefixes.split(":")[0]}\n'
    assert ros2(prefixes, 'pkg', 'executables').stdout == 'arm talk\nbase talk\n'
    assert ros2(prefixes, 'pkg', 'executables', 'leg').returncode == 1


@pytest.mark.parametrize('arguments', [('node', 'list'), ('launch', 'a', 'b'), ('pkg', 'create')])
def test_everything_else_needs_ros(prefixes: str, arguments: tuple[str, ...]) -> None:
    done = ros2(prefixes, *arguments)
    assert done.returncode == 2
    assert 'needs a ROS installation' in done.stderr
