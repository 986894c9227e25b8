"""`ftmanip replay --live`: the real fault monitor, on recorded time, finds the recorded fault."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ft_manip_interfaces.msg import JointFault
from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.cli.main import main
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.conversions import nanoseconds

pytestmark = pytest.mark.node

CASE = Path(__file__).resolve().parents[2] / 'bags' / 'locked_joint' / 'bag'


RATE = 2.0


def test_a_node_on_recorded_time_finds_the_fault(
    start_node: Callable[..., Any], start_process: Callable[..., Any], probe: Any
) -> None:
    bag = open_bag(CASE)
    recorded = next(
        message
        for record in bag.messages(['/fault_events'])
        if (message := bag.decode(record)).state == JointFault.LOCKED
    )
    events = probe.listen(JointFault, topics.FAULT_EVENTS, topics.EVENT_QOS)
    monitor = start_node('fault_monitor', params={'use_sim_time': True})
    monitor.wait_for('active', 200.0)
    ftmanip = shutil.which('ftmanip')
    assert ftmanip
    until = (nanoseconds(recorded.stamp) - bag.start) * 1e-9 + 1.0
    begin = time.monotonic()
    player = start_process(
        ftmanip, 'replay', str(CASE), '--live', '--rate', str(RATE), '--to', str(until)
    )
    probe.until(lambda: not player.running, 200.0, 'the player to end')
    assert player.wait(1.0) == 0, player.output
    assert time.monotonic() - begin > until / RATE
    locked = [event for event in events if event.state == JointFault.LOCKED]
    assert locked, f'{monitor.output}\n{player.output}'
    found = locked[0]
    assert found.name == recorded.name
    assert found.frozen_position == pytest.approx(recorded.frozen_position, abs=1e-3)
    assert abs(nanoseconds(found.stamp) - nanoseconds(recorded.stamp)) < 100_000_000
    assert 'played' in player.output


def test_nobody_listens(
    start_process: Callable[..., Any], ros_domain: int, capsys: pytest.CaptureFixture[str]
) -> None:
    player = start_process(shutil.which('ftmanip'), 'replay', str(CASE), '--live')
    assert player.wait(200.0) == 1, player.output
    assert 'nobody subscribed' in player.output
    assert main(['replay', str(CASE), '--live', '--rate', '0']) == 2
    assert '--rate' in capsys.readouterr().err
