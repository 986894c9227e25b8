"""How a node's process ends: by itself within its grace, by force after it."""

from __future__ import annotations

import signal
import sys

import pytest

pytestmark = pytest.mark.node

# A node that takes its time to stop, as a recorder with a slow disk does.
SLOW = """
import sys, time
from ft_manip_ros.nodes.managed_node import ManagedNode
from ft_manip_ros.nodes.process import run

class Slow(ManagedNode):
    def __init__(self):
        super().__init__('slow')

    def activate(self):
        print('at work', flush=True)

    def deactivate(self):
        time.sleep({takes})
        print('finished', flush=True)

sys.exit(run(Slow, ['slow'], grace={grace}))
"""


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_node_that_needs_longer_is_given_its_grace(number, start_process):
    node = start_process(sys.executable, '-c', SLOW.format(takes=2.0, grace=60.0))
    node.wait_for('at work')
    assert node.stop(number, timeout=60.0) == 0
    assert 'finished' in node.output


def test_after_its_grace_it_is_ended(start_process):
    node = start_process(sys.executable, '-c', SLOW.format(takes=600.0, grace=0.5))
    node.wait_for('at work')
    assert node.stop(signal.SIGINT, timeout=60.0) == 128 + signal.SIGINT
    assert 'still busy' in node.output
    assert 'finished' not in node.output
