"""Set-up on machines that lack something: one line that says what, and nothing half made."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TOOLS = ('/usr/bin', '/bin')
COMPILERS = ('c++', 'g++', 'clang++', 'cc', 'gcc', 'clang')


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Copy what set-up reads before it installs anything."""
    for folder in ('scripts', 'requirements'):
        shutil.copytree(ROOT / folder, tmp_path / 'checkout' / folder)
    return tmp_path / 'checkout'


def machine_without(folder: Path, *hidden: str) -> Path:
    """Make a folder of links to every system program but some."""
    folder.mkdir()
    for tools in TOOLS:
        for program in Path(tools).iterdir():
            link = folder / program.name
            if program.name not in hidden and not link.is_symlink():
                link.symlink_to(program)
    return folder


def set_up(checkout: Path, path: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run set-up on a machine that has only the programs in one folder."""
    return subprocess.run(
        [str(checkout / 'scripts' / 'setup.sh')],
        env={'HOME': str(checkout), 'PATH': str(path), **variables},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def has_whole_python() -> bool:
    """Return whether the system's own Python could be set up here at all."""
    code = (
        'import ensurepip, os, sys, sysconfig, venv\n'
        'header = os.path.join(sysconfig.get_path("include"), "Python.h")\n'
        'sys.exit(not (os.path.exists(header) and (3, 10) <= sys.version_info < (3, 14)))'
    )
    done = subprocess.run(['/usr/bin/python3', '-c', code], capture_output=True, check=False)
    return done.returncode == 0


needs_system_python = pytest.mark.skipif(
    not has_whole_python(), reason="the system's python3 lacks venv, headers or the right version"
)


@needs_system_python
@pytest.mark.parametrize(
    ('hidden', 'named'),
    [(COMPILERS, 'g++ gcc'), (('cmake',), 'cmake'), (('make', 'cmake'), 'cmake make')],
)
def test_a_missing_tool_is_named(
    checkout: Path, tmp_path: Path, hidden: tuple[str, ...], named: str
) -> None:
    versions = [f'{name}-{version}' for name in hidden for version in range(8, 20)]
    path = machine_without(tmp_path / 'bin', *hidden, *versions)
    done = set_up(checkout, path, PYTHON='/usr/bin/python3')
    assert done.returncode == 1
    assert done.stderr.count('\n') == 1
    assert f'sudo apt install {named})' in done.stderr
    assert not (checkout / '.venv').exists()


def test_python_that_does_not_run_is_refused(checkout: Path) -> None:
    done = set_up(checkout, Path(os.defpath.split(':')[-1]), PYTHON='/nowhere/python3')
    assert done.returncode == 1
    assert done.stderr.count('\n') == 1
    assert 'PYTHON=/nowhere/python3' in done.stderr


def test_another_ros_is_refused(checkout: Path) -> None:
    done = set_up(checkout, Path('/usr/bin'), ROS_DISTRO='humble')
    assert done.returncode == 1
    assert 'ROS 2 humble is sourced, but this package is for ROS 2 Jazzy' in done.stderr


@needs_system_python
def test_no_network_is_said_and_leaves_nothing_that_looks_whole(checkout: Path) -> None:
    index = {
        'PIP_INDEX_URL': 'http://127.0.0.1:9',
        'PIP_RETRIES': '0',
        'PIP_NO_CACHE_DIR': '1',
    }
    done = set_up(checkout, Path('/usr/bin'), PYTHON='/usr/bin/python3', **index)
    assert done.returncode == 1
    assert 'cannot reach the Python package index' in done.stderr.splitlines()[-1]
    assert not (checkout / '.venv' / 'setup.key').exists()


def test_a_path_with_a_space_is_refused(checkout: Path) -> None:
    spaced = checkout.with_name('check out')
    checkout.rename(spaced)
    done = set_up(spaced, Path('/usr/bin'))
    assert done.returncode == 1
    assert 'has a space in it' in done.stderr
