"""The test fixtures themselves: domains never collide, processes never stay."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest
from std_msgs.msg import String

from support.domain import free_domain

TALKER = """
import rclpy, sys
from std_msgs.msg import String
rclpy.init()
node = rclpy.create_node('talker')
publisher = node.create_publisher(String, 'words', 10)
node.create_timer(0.05, lambda: publisher.publish(String(data='hello')))
print('up', flush=True)
try:
    rclpy.spin(node)
except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
    pass
"""

# A grandchild that ignores every polite signal.
STUBBORN = """
import subprocess, sys, time
subprocess.Popen([sys.executable, '-c', '''
import signal, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
signal.signal(signal.SIGTERM, signal.SIG_IGN)
print('deaf', flush=True)
time.sleep(600)
'''])
"""


def test_domains_of_two_processes_differ() -> None:
    code = (
        'from support.domain import free_domain\n'
        'with free_domain() as domain: print(domain, flush=True); input()'
    )
    env = {**os.environ, 'PYTHONPATH': os.path.dirname(os.path.dirname(__file__))}
    with free_domain() as mine:
        assert os.environ['ROS_DOMAIN_ID'] == str(mine)
        others = [
            subprocess.Popen(
                [sys.executable, '-c', code],
                env=env,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            for _ in range(3)
        ]
        domains = {mine, *(int(other.stdout.readline()) for other in others if other.stdout)}
        for other in others:
            other.communicate('\n')
    assert len(domains) == 4
    assert domains <= set(range(1, 102))


@pytest.mark.node
def test_messages_arrive_from_a_process(start_process, probe) -> None:
    talker = start_process(sys.executable, '-c', TALKER)
    talker.wait_for('up')
    words = probe.listen(String, 'words')
    probe.until(lambda: words, 20.0, 'a word')
    assert words[0].data == 'hello'
    talker.stop(signal.SIGINT)
    assert not talker.members()


def test_what_does_not_end_is_killed_and_reported(start_process) -> None:
    process = start_process(sys.executable, '-c', STUBBORN)
    process.wait_for('deaf')
    assert len(process.clean_up()) == 1
    assert not process.members()
