"""The example node hears of a fault through the graph."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from ft_manip_interfaces.srv import FreezeJoint
from ft_manip_ros.nodes import topics

pytestmark = pytest.mark.node
EXAMPLE = Path(__file__).resolve().parents[2] / 'examples' / 'watch_faults.py'


def test_the_watcher_tells_of_a_joint_that_an_operator_froze(start_node, start_process, probe):
    start_node('fault_monitor').wait_for('active')
    watcher = start_process(sys.executable, str(EXAMPLE))
    watcher.wait_for('no joint is frozen')
    request = FreezeJoint.Request(joint='joint_2', position=0.25, reason='it smokes')
    assert probe.call(FreezeJoint, topics.FREEZE_JOINT, request).success
    watcher.wait_for(r'joint_2 is frozen at 0.2500')
    watcher.wait_for('it smokes')
    # The interpreter takes its time to end on a busy machine.
    assert watcher.stop(timeout=30.0) == 0, watcher.output
