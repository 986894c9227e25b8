"""No node may overwrite what its base classes keep under the same name."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import rclpy.lifecycle.node
import rclpy.node

import ft_manip_ros.nodes.managed_node as base

NODES = Path(base.__file__).parent
# "self.name =", "self.name: type =", also inside methods.
ASSIGNED = re.compile(r'self\.(\w+)\s*(?::[^=\n]+)?=(?!=)')


def assigned(path):
    return set(ASSIGNED.findall(Path(path).read_text()))


KEPT = assigned(rclpy.node.__file__) | assigned(rclpy.lifecycle.node.__file__)


def node_files():
    return sorted(p for p in NODES.glob('*.py') if '(ManagedNode)' in p.read_text())


def test_the_names_are_found_at_all():
    assert {'_state_machine'} <= KEPT
    assert len(node_files()) >= 6


@pytest.mark.parametrize('path', node_files(), ids=lambda p: p.stem)
def test_names_do_not_collide(path):
    inherited = KEPT | assigned(base.__file__) | set(dir(base.ManagedNode))
    assert not assigned(path) & inherited
    assert not assigned(base.__file__) & KEPT
