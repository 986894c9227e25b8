"""The arm that a node's parameters name."""

from __future__ import annotations

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.nodes.managed_node import ManagedNode


def load_arm_parameter(node: ManagedNode) -> SerialChain:
    """Load the arm of the parameters ``arm``, ``base`` and ``tip`` (`ARM_PARAMETERS`).

    Raises
    ------
    InputError
        Naming the file and the line or field, and what would be valid.
    """
    return load_arm(
        node.param('arm'), base=node.param('base') or None, tip=node.param('tip') or None
    )
