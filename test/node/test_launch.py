"""The launch file brings the graph up and takes it down (only where ROS brings `launch`)."""

from __future__ import annotations

import shutil
import signal

import pytest

pytest.importorskip('launch_ros', reason='launch files need a ROS installation')


@pytest.mark.node
def test_every_node_becomes_active_and_ends(start_process) -> None:
    ros2 = shutil.which('ros2')
    assert ros2
    arguments = ('record:=false', 'arm:=paredis_table_3')
    launch = start_process(ros2, 'launch', 'ft_manip_ros', 'bringup.launch.py', *arguments)
    for node in ('arm_sim', 'fault_monitor', 'replanner', 'workspace'):
        launch.wait_for(f'{node} is active', timeout=120.0)
    launch.stop(signal.SIGINT, timeout=20.0)
    assert not launch.members()
    assert 'Traceback' not in launch.output
