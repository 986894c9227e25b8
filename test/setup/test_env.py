"""`env.sh` in every shell that is here: from any folder, twice, and before set-up."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SHELLS = list(filter(None, map(shutil.which, ('sh', 'dash', 'bash', 'zsh'))))


def in_shell(shell: str, script: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a script in a shell without its start-up files, in the environment of a login."""
    kept = {name: os.environ[name] for name in ('ROS_DISTRO',) if name in os.environ}
    return subprocess.run(
        [shell, '-c', script],
        cwd=folder,
        env={'HOME': str(folder), 'PATH': '/usr/local/bin:/usr/bin:/bin', 'ZDOTDIR': '/', **kept},
        capture_output=True,
        text=True,
        check=False,
    )


pytestmark = [
    pytest.mark.parametrize('shell', SHELLS),
    pytest.mark.skipif(
        'ROS_DISTRO' in os.environ or not (ROOT / '.venv' / 'setup.key').exists(),
        reason='needs a checkout that `make setup` set up without a ROS installation',
    ),
]


def test_from_another_folder(shell: str, tmp_path: Path) -> None:
    script = f'set -eu; . {ROOT}/env.sh; ros2 pkg prefix ft_manip_ros; command -v ftmanip; '
    script += 'python3 -c "import ft_manip_interfaces.msg, ft_manip_ros, rclpy"; '
    script += 'echo $ROS_AUTOMATIC_DISCOVERY_RANGE'
    done = in_shell(shell, script, tmp_path)
    assert done.returncode == 0, done.stderr
    prefix = ROOT / 'install' / 'ft_manip_ros'
    assert done.stdout.split() == [str(prefix), f'{prefix}/bin/ftmanip', 'LOCALHOST']


def test_twice_is_once(shell: str, tmp_path: Path) -> None:
    once = in_shell(shell, f'. {ROOT}/env.sh; env | sort', tmp_path)
    twice = in_shell(shell, f'. {ROOT}/env.sh; . {ROOT}/env.sh; env | sort', tmp_path)
    assert once.returncode == 0
    assert once.stdout == twice.stdout
    assert '_ftm' not in once.stdout


def test_what_is_set_stays(shell: str, tmp_path: Path) -> None:
    script = f'ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET; . {ROOT}/env.sh; '
    done = in_shell(shell, script + 'echo $ROS_AUTOMATIC_DISCOVERY_RANGE', tmp_path)
    assert done.stdout == 'SUBNET\n'


def test_before_set_up(shell: str, tmp_path: Path) -> None:
    shutil.copy(ROOT / 'env.sh', tmp_path)
    done = in_shell(shell, '. ./env.sh || echo refused; echo $AMENT_PREFIX_PATH', tmp_path)
    assert done.stdout == 'refused\n\n'
    assert done.stderr == f"env.sh: {tmp_path} is not set up yet: run 'make setup' there first\n"
