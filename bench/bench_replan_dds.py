"""Fault message to published plan: the whole way over DDS, beside a bare Trigger round trip."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from bench.bench_replan import FAULTS, GOALS, fault
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.goal import Task

sys.path.append(str(Path(__file__).parents[1] / 'test'))

_RESTATE = 0.2  # s without a plan after which the arm says again where it is
_TRIGGER = """
import rclpy
from std_srvs.srv import Trigger
rclpy.init()
node = rclpy.create_node('bare')
node.create_service(Trigger, 'bare', lambda request, response: response)
rclpy.spin(node)
"""


def run() -> None:
    """Print the time from a fault message to the plan as another process sees it."""
    from support.domain import free_domain

    print(
        'Table 3: fault message sent to plan received | computed in the node, with its message |'
    )
    print('bare Trigger round trip in the same run')
    print(f'{"goals":>5} {"faults":>7} ' + ' '.join([f'{"p50 ms":>9} {"p99 ms":>9}'] * 3))
    with free_domain() as domain:
        environment = {**os.environ, 'ROS_DOMAIN_ID': str(domain)}
        processes = [
            subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
            for command in (
                [sys.executable, '-m', 'ft_manip_ros.nodes.replanner'],
                [sys.executable, '-c', _TRIGGER],
            )
        ]
        try:
            _measure(domain)
        finally:
            for process in processes:
                process.terminate()
            for process in processes:
                process.wait(10.0)


def _measure(domain: int) -> None:
    from sensor_msgs.msg import JointState
    from std_srvs.srv import Trigger

    from ft_manip_interfaces.msg import FaultState, RecoveryPlan
    from ft_manip_interfaces.msg import Task as TaskMessage
    from ft_manip_ros.nodes import topics
    from ft_manip_ros.nodes.conversions import stamp, task_to_message
    from support.probe import Probe

    chain = load_arm('paredis_table_3')
    probe = Probe(domain, 'bench_replan')
    states = probe.publisher(JointState, topics.JOINT_STATES, topics.SENSOR_QOS, timeout=120.0)
    tasks = probe.publisher(TaskMessage, topics.TASK, topics.LATCHED_QOS)
    faults = probe.publisher(FaultState, topics.FAULT_STATE, topics.LATCHED_QOS)
    plans = probe.listen(RecoveryPlan, topics.RECOVERY_PLAN, topics.LATCHED_QOS)
    healthy = probe.listen(RecoveryPlan, 'replanner/task_plan', topics.LATCHED_QOS)
    client = probe.node.create_client(Trigger, 'bare')
    probe.until(client.service_is_ready, 60.0, 'the bare service')
    for count in GOALS:
        rng = np.random.default_rng(count)
        whole, computed, bare = [], [], []
        for k in range(FAULTS):
            goals, frozen, start, speed = fault(chain, rng, count, None)
            now = probe.node.get_clock().now().nanoseconds
            state = JointState(
                name=list(chain.joint_names), position=start.tolist(), velocity=speed.tolist()
            )
            # A state and a healed arm first, then the task, then the fault.
            message = FaultState()
            message.header.stamp = state.header.stamp = stamp(now)
            states.publish(state)
            faults.publish(message)
            name = f'task_{count}_{k}'
            tasks.publish(task_to_message(Task(name, tuple(goals)), now, 'base'))

            def restate(state: Any = state) -> None:
                state.header.stamp = stamp(probe.node.get_clock().now().nanoseconds)
                states.publish(state)

            _await(probe, healthy, name, [], restate)
            message = FaultState(
                frozen_joints=list(frozen), frozen_positions=list(frozen.values())
            )
            message.header.stamp = stamp(now)
            begin = time.perf_counter()
            faults.publish(message)
            _await(probe, plans, name, list(frozen.values()), restate)
            whole.append(time.perf_counter() - begin)
            computed.append(plans[-1].compute_time)
            begin = time.perf_counter()
            future = client.call_async(Trigger.Request())
            probe.until(future.done, 20.0, 'the bare answer')
            bare.append(time.perf_counter() - begin)
        rows = [np.percentile(values, [50, 99]) * 1e3 for values in (whole, computed, bare)]
        print(
            f'{count:5} {FAULTS:7} ' + ' '.join(f'{p50:9.2f} {p99:9.2f}' for p50, p99 in rows),
            flush=True,
        )
    probe.close()


def _await(
    probe: Any, plans: list[Any], task: str, frozen: list[float], restate: Callable[[], None]
) -> None:
    """Wait for the plan of a task with joints frozen at these positions.

    An arm goes on saying where it is; the node waits for that where a state has got old.
    """
    due = time.perf_counter() + _RESTATE

    def there() -> bool:
        nonlocal due
        if time.perf_counter() > due:
            restate()
            due += _RESTATE
        return bool(
            plans and plans[-1].task == task and list(plans[-1].frozen_positions) == frozen
        )

    probe.until(there, 20.0, f'the plan of {task}')
