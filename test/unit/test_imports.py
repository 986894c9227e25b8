"""Processes that start often do not import what they never use."""

from __future__ import annotations

import subprocess
import sys

import pytest

COMPILER = ('numba', 'llvmlite')
PLOTS = ('matplotlib',)
COLLISIONS = ('pinocchio', 'coal')
CLUSTER = ('dask', 'distributed')


@pytest.mark.parametrize(
    ('module', 'heavy'),
    [
        ('nodes.arm_sim', (*COMPILER, *PLOTS, *COLLISIONS, *CLUSTER)),
        ('nodes.demo', (*COMPILER, *PLOTS, *COLLISIONS, *CLUSTER)),
        ('nodes.recorder', (*COMPILER, *PLOTS, *COLLISIONS, *CLUSTER)),
        ('nodes.fault_monitor', (*PLOTS, *COLLISIONS, *CLUSTER)),
        ('nodes.workspace', (*PLOTS, *COLLISIONS, *CLUSTER)),
        ('nodes.designer', (*PLOTS, *COLLISIONS, *CLUSTER)),
        ('nodes.replanner', (*PLOTS, *CLUSTER)),
        ('cli.replay_command', ('scipy.interpolate', 'scipy.spatial', *PLOTS, *CLUSTER)),
        ('cli.main', ('numpy', *COMPILER, *PLOTS, *COLLISIONS, *CLUSTER)),
    ],
)
def test_heavy_packages_are_left_alone(module: str, heavy: tuple[str, ...]) -> None:
    code = f'import sys, ft_manip_ros.{module}; print(*sys.modules)'
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=True, timeout=120
    )
    imported = done.stdout.split()
    assert f'ft_manip_ros.{module}' in imported
    assert not set(imported) & set(heavy)
