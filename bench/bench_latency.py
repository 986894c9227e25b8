"""From the lock of a joint to the published fault and plan, over DDS, beside a bare round trip.

The simulated arm, the fault monitor and the re-planner run as processes of their own, as in the
demo. Between two runs they are led through cleanup and back, so every run starts with a fresh
monitor. Which joint locks, when, and from which posture is drawn from the run's seed.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import rclpy
from lifecycle_msgs.msg import Transition
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.logging import LoggingSeverity
from std_srvs.srv import Trigger

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.task_file import load_task
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.demo_domain import own_domain
from ft_manip_ros.nodes.demo_observer import START_TIME, Observer
from ft_manip_ros.nodes.demo_processes import Processes
from ft_manip_ros.nodes.demo_record import Record
from ft_manip_ros.nodes.demo_run import execute, start_posture
from ft_manip_ros.nodes.demo_timeline import Timeline

RUNS = 50
ROUND_TRIPS = 500
ARM, TASK = 'paredis_table_3', 'paredis_eq_11'
NODES = ('arm_sim', 'fault_monitor', 'replanner')
_TRIGGER_SERVER = """
import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import Trigger
rclpy.init()
node = rclpy.create_node('trigger_server')
node.create_service(Trigger, 'bare_trigger', lambda request, response: response)
executor = SingleThreadedExecutor()
executor.add_node(node)
executor.spin()
"""


class _Silent(Timeline):
    """Fifty timelines are more than anybody reads."""

    def line(self, who: str, text: str, *, good: bool | None = None) -> None:
        """Say nothing."""


def run() -> None:
    """Print the latencies."""
    with own_domain(None), tempfile.TemporaryDirectory() as folder:
        rclpy.init()
        observer = Observer()
        observer.get_logger().set_level(LoggingSeverity.WARN)
        try:
            observer.until(lambda: observer.active, 20.0, 'the observer')
            trips = _round_trips(observer)
            with Processes(Path(folder)) as processes:
                observer.alarm = processes.dead
                records = _runs(observer, processes)
        finally:
            observer.close()
            rclpy.try_shutdown()
    print(f'{len(records)} runs of {TASK} on {ARM}, {len(trips)} round trips; ms')
    print(f'{"":<44}{"p50":>9}{"p99":>9}{"max":>9}')
    _row('bare Trigger service round trip', trips)
    _row('lock -> fault published', [r.detection_latency for r in records])
    _row('  of which until the deciding sample', [_of_sample(r) for r in records])
    _row('fault published -> plan published', [_of_plan(r) for r in records])
    _row('  of which computing', [r.compute_time for r in records])
    _row('lock -> plan published', [r.plan_latency for r in records])
    problems = [f'seed {k}: {p}' for k, r in enumerate(records) for p in r.problems()]
    points = [p for r in records for p in r.points if p.planned]
    print(
        f'{len(points)} points after failures, worst {max(p.error for p in points) * 1e3:.3f} mm'
    )
    print(f'contradictions: {len(problems)}', *problems, sep='\n  ')
    ratio = np.median([_of_plan(r) for r in records]) / np.median(trips)
    print(f'fault -> plan takes {ratio:.1f} x a bare Trigger round trip (medians)')


def _of_sample(record: Record) -> float:
    return (record.detected_stamp - record.locked_at) * 1e-9


def _of_plan(record: Record) -> float:
    return record.plan_latency - record.detection_latency


def _row(name: str, values: list[float] | Array) -> None:
    ms = np.asarray(values) * 1e3
    p50, p99 = np.percentile(ms, [50, 99])
    print(f'{name:<44}{p50:>9.1f}{p99:>9.1f}{ms.max():>9.1f}')


def _round_trips(observer: Observer) -> Array:
    server = subprocess.Popen([sys.executable, '-c', _TRIGGER_SERVER], stderr=subprocess.DEVNULL)
    client = observer.create_client(Trigger, 'bare_trigger')
    try:
        observer.until(client.service_is_ready, START_TIME, 'the Trigger server')
        times = np.empty(ROUND_TRIPS)
        for k in range(ROUND_TRIPS):
            started = time.perf_counter()
            future = client.call_async(Trigger.Request())
            observer.until(future.done, 10.0, 'its answer')
            times[k] = time.perf_counter() - started
        # The first ones still meet caches that are cold.
        return times[10:]
    finally:
        observer.destroy_client(client)
        server.terminate()
        server.wait()


def _runs(observer: Observer, processes: Processes) -> list[Record]:
    chain, task = load_arm(ARM), load_task(TASK)
    for node in NODES:
        processes.start(node, {'arm': ARM, 'autostart': False})
    records = []
    for seed in range(RUNS):
        rng = np.random.default_rng(seed)
        _set_start(observer, chain, rng)
        for node in NODES:
            observer.transit(node, Transition.TRANSITION_CONFIGURE, START_TIME)
            observer.transit(node, Transition.TRANSITION_ACTIVATE, START_TIME)
        observer.forget()
        observer.until_joined(topics.JOINT_STATES, publishers=1, subscriptions=3)
        observer.until_joined(topics.JOINT_TRAJECTORY, publishers=1, subscriptions=3)
        observer.until_joined(topics.TASK, publishers=1, subscriptions=1)
        observer.until_joined(topics.FAULT_STATE, publishers=1, subscriptions=2)
        observer.until(lambda: observer.states, 10.0, 'joint states')
        records.append(
            execute(chain, task, list(chain.joint_names), True, rng, observer, _Silent())
        )
        observer.withdraw_task()
        for node in NODES:
            observer.transit(node, Transition.TRANSITION_DEACTIVATE, 10.0)
            observer.transit(node, Transition.TRANSITION_CLEANUP, 10.0)
    return records


def _set_start(observer: Observer, chain: SerialChain, rng: np.random.Generator) -> None:
    value = ParameterValue(
        type=ParameterType.PARAMETER_DOUBLE_ARRAY,
        double_array_value=start_posture(chain, rng).tolist(),
    )
    request = SetParameters.Request(parameters=[Parameter(name='start', value=value)])
    answer = observer.call(SetParameters, 'arm_sim/set_parameters', request, timeout=START_TIME)
    assert answer.results[0].successful, answer.results[0].reason


if __name__ == '__main__':
    run()
