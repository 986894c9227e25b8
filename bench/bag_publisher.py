"""What `bench_bags` records: a 1 kHz arm and the rarer messages of the other nodes."""

from __future__ import annotations

import sys
import time

import rclpy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from ft_manip_interfaces.msg import FaultState, JointFault, RecoveryPlan, Task, TaskGoal
from ft_manip_ros.nodes import topics

JOINTS = 7


def main() -> None:
    """Publish for argv[1] seconds at argv[2] Hz; print when it begins and how many were sent."""
    duration, rate = float(sys.argv[1]), float(sys.argv[2])
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('bench_publisher')
    states = node.create_publisher(JointState, topics.JOINT_STATES, topics.SENSOR_QOS)
    latched = [
        (node.create_publisher(kind, topic, topics.LATCHED_QOS), message)
        for kind, topic, message in (
            (Task, topics.TASK, Task(name='t', goals=[TaskGoal()] * 5)),
            (FaultState, topics.FAULT_STATE, FaultState(joints=[JointFault()] * JOINTS)),
            (RecoveryPlan, topics.RECOVERY_PLAN, RecoveryPlan(reason='x' * 100)),
        )
    ]
    while not states.get_subscription_count():
        time.sleep(0.05)
    time.sleep(1.0)
    print('begin', flush=True)
    names = [f'joint_{k + 1}' for k in range(JOINTS)]
    start, count = time.monotonic(), round(duration * rate)
    for i in range(count):
        left = start + i / rate - time.monotonic()
        if left > 0.0:
            time.sleep(left)
        t = i / rate
        message = JointState(name=names, position=[t + 0.1 * k for k in range(JOINTS)])
        message.velocity, message.effort = [1.0] * JOINTS, [0.5 + t] * JOINTS
        message.header.stamp.sec, message.header.stamp.nanosec = int(t), int(t % 1.0 * 1e9)
        states.publish(message)
        if i % 100 == 0:
            for publisher, other in latched:
                publisher.publish(other)
    time.sleep(0.5)
    print(count, flush=True)
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
