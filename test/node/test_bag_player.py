"""`ftmanip replay --live`: the real fault monitor, on recorded time, finds the recorded fault."""

from __future__ import annotations

import os
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path
from typing import Any

import pytest

from ft_manip_interfaces.msg import JointFault
from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.cli.main import main
from ft_manip_ros.nodes import bag_player, topics
from ft_manip_ros.nodes.conversions import nanoseconds

pytestmark = pytest.mark.node

CASE = Path(__file__).resolve().parents[2] / 'bags' / 'locked_joint' / 'bag'
RATE = 2.0


@contextmanager
def stuttering(*pids: int) -> Iterator[None]:
    """Keep one process after the other from running, for 0.3 s each, as a busy machine does."""
    over = threading.Event()

    def stutter() -> None:
        for pid in cycle(pids):
            if over.wait(0.2):
                return
            os.kill(pid, signal.SIGSTOP)
            over.wait(0.3)
            os.kill(pid, signal.SIGCONT)

    thread = threading.Thread(target=stutter)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def test_a_node_on_recorded_time_finds_the_fault_on_a_machine_that_stutters(
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
    with stuttering(monitor.pid, player.pid):
        probe.until(lambda: player.output, 200.0, 'the player to end')
    assert time.monotonic() - begin > until / RATE
    assert player.wait(60.0) == 0, player.output
    probe.until(lambda: any(e.state == JointFault.LOCKED for e in events), 20.0, 'the fault')
    locked = [event for event in events if event.state == JointFault.LOCKED]
    assert locked, f'{monitor.output}\n{player.output}'
    found = locked[0]
    assert found.name == recorded.name
    assert found.frozen_position == pytest.approx(recorded.frozen_position, abs=1e-3)
    assert abs(nanoseconds(found.stamp) - nanoseconds(recorded.stamp)) < 100_000_000


def test_nobody_listens(
    ros_domain: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bag_player, '_WAIT', 1.0)
    assert main(['replay', str(CASE), '--live']) == 1
    assert 'nobody subscribed to /joint_states' in capsys.readouterr().out
    assert main(['replay', str(CASE), '--live', '--rate', '0']) == 2
    assert '--rate' in capsys.readouterr().err
