"""The arm that a node's parameters name, or that a robot description on the graph describes."""

from __future__ import annotations

import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import String

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.managed_node import ManagedNode

# Value of the parameter ``arm`` that means: as the topic says.
TOPIC = 'topic'
_PATIENCE = 30.0  # s for a description to come


def load_arm_parameter(node: ManagedNode) -> SerialChain:
    """Load the arm of the parameters ``arm``, ``base`` and ``tip`` (`ARM_PARAMETERS`).

    Raises
    ------
    InputError
        Naming the file and the line or field, and what would be valid.
    """
    return load_arm(
        arm_source(node), base=node.param('base') or None, tip=node.param('tip') or None
    )


def arm_source(node: ManagedNode) -> str:
    """Return what the parameter ``arm`` says, or for `TOPIC` the text of the robot description.

    Waits for the description, which is latched.

    Raises
    ------
    InputError
        If none comes.
    """
    arm = str(node.param('arm'))
    return _described(node) if arm == TOPIC else arm


def _described(node: ManagedNode) -> str:
    # The node itself is busy with being configured: another one listens, on the same context.
    listener = rclpy.create_node(
        f'{node.get_name()}_description',
        context=node.context,
        namespace=node.get_namespace(),
        start_parameter_services=False,
        enable_rosout=False,
    )
    heard: list[String] = []
    executor = SingleThreadedExecutor(context=node.context)
    try:
        executor.add_node(listener)
        subscription = listener.create_subscription(
            String, topics.ROBOT_DESCRIPTION, heard.append, topics.LATCHED_QOS
        )
        deadline = time.monotonic() + _PATIENCE
        while not heard and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.1)
        if not heard:
            raise InputError(
                "parameter arm: 'topic'",
                f'no URDF came on {subscription.topic_name} within {_PATIENCE:g} s',
            )
        return str(heard[-1].data)
    finally:
        executor.shutdown(timeout_sec=0.0)
        listener.destroy_node()
