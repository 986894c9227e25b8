"""Fixtures for every test: a ROS domain of one's own, node processes, recorded telemetry."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from support.domain import free_domain
from support.processes import NodeProcess

StartNode = Callable[..., NodeProcess]


@pytest.fixture(scope='session', autouse=True)
def _never_the_default_domain() -> Iterator[None]:
    with free_domain():
        yield


@pytest.fixture(scope='module')
def ros_domain() -> Iterator[int]:
    """Give the module's tests a ROS_DOMAIN_ID that no other process uses, on loopback only."""
    with free_domain() as domain:
        yield domain


@pytest.fixture
def start_process(ros_domain: int) -> Iterator[StartNode]:
    """Start commands as processes of their own; afterwards none may be left.

    The fixture is a function ``start_process(*command, env=None) -> NodeProcess``.
    """
    started: list[NodeProcess] = []

    def start(*command: str, env: dict[str, str] | None = None) -> NodeProcess:
        started.append(NodeProcess(command, env))
        return started[-1]

    yield start
    left = [name for process in reversed(started) for name in process.clean_up()]
    assert not left, f'these did not end by themselves: {left}'


@pytest.fixture
def start_node(start_process: StartNode) -> StartNode:
    """Start nodes of this package with `ros2 run`.

    The fixture is a function ``start_node(executable, *arguments, params=None, name=None,
    env=None) -> NodeProcess``; ``params`` are ROS parameters and ``name`` renames the node.
    """
    ros2 = shutil.which('ros2')
    assert ros2, 'no ros2 on PATH: source env.sh first'

    def start(
        executable: str,
        *arguments: str,
        params: dict[str, Any] | None = None,
        name: str | None = None,
        env: dict[str, str] | None = None,
    ) -> NodeProcess:
        ros_arguments = [] if name is None else ['-r', f'__node:={name}']
        for key, value in (params or {}).items():
            ros_arguments += ['-p', f'{key}:={json.dumps(value)}']
        if ros_arguments:
            ros_arguments = ['--ros-args', *ros_arguments]
        command = [ros2, 'run', 'ft_manip_ros', executable, *arguments, *ros_arguments]
        return start_process(*command, env=env)

    return start


@pytest.fixture
def probe(ros_domain: int) -> Iterator[Any]:
    """Join the module's domain with a node inside the test process (`support.probe.Probe`)."""
    from support.probe import Probe

    node = Probe(ros_domain)
    yield node
    node.close()


@pytest.fixture(scope='session')
def telemetry() -> Path:
    """Return the folder with recorded robot data, or skip the test where there is none."""
    folder = os.environ.get('FT_MANIP_TELEMETRY')
    if not folder:
        pytest.skip('FT_MANIP_TELEMETRY does not name a folder with recorded robot data')
    if not Path(folder).is_dir():
        pytest.fail(f'FT_MANIP_TELEMETRY={folder} is not a folder')
    return Path(folder)
