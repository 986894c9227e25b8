"""A node of one's own on the graph: tells of every fault, and what becomes of the task.

ros2 run ft_manip_ros fault_monitor &
python examples/watch_faults.py
"""

import signal
import threading

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ft_manip_interfaces.msg import FaultState, RecoveryPlan
from ft_manip_ros.nodes import topics


class FaultWatcher(Node):
    """Logs what `fault_monitor` and `replanner` publish, latched, so nothing is missed."""

    def __init__(self) -> None:
        super().__init__('fault_watcher')
        self.create_subscription(
            FaultState, topics.FAULT_STATE, self.on_fault_state, topics.LATCHED_QOS
        )
        self.create_subscription(
            RecoveryPlan, topics.RECOVERY_PLAN, self.on_plan, topics.LATCHED_QOS
        )
        self.get_logger().info('watching')

    def on_fault_state(self, message: FaultState) -> None:
        """Tell which joints are frozen, and where."""
        if not message.frozen_joints:
            self.get_logger().info('no joint is frozen')
        for name, position in zip(message.frozen_joints, message.frozen_positions, strict=True):
            cause = next(joint.cause for joint in message.joints if joint.name == name)
            self.get_logger().warning(f'{name} is frozen at {position:.4f}: {cause}')

    def on_plan(self, message: RecoveryPlan) -> None:
        """Tell what the re-planner makes of it."""
        self.get_logger().info(f'plan: {message.reason}')


def main() -> None:
    """Watch until Ctrl-C or SIGTERM."""
    # rclpy's own handlers shut the context down from another thread, under the feet of what is
    # cleaned up here.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    node = FaultWatcher()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not stop.is_set():
        executor.spin_once(timeout_sec=0.2)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == '__main__':
    main()
