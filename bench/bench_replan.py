"""Fault message to published plan: the computation, and the whole way over DDS."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from bench.free_space import MOST_JOINTS, FreeSpace
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.goal import Goal, Task
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.collision_setup import CollisionOptions, make_checker
from ft_manip_ros.core.planning.plan import Plan, PlanStatus
from ft_manip_ros.core.planning.replan import plan_task
from ft_manip_ros.core.planning.settings import PlanSettings
from ft_manip_ros.core.planning.warm_up import warm_up

sys.path.append(str(Path(__file__).parents[1] / 'test'))

FAULTS = 500
# Of so many tasks that were not finished it is looked up whether there is a way.
DOUBTED = 8
GOALS = (3, 10, 50)
PANDA = 'package://example-robot-data/robots/panda_description/urdf/panda.urdf'
BASE, TIP = 'panda_link0', 'panda_link8'
_RESTATE = 0.2  # s without a plan after which the arm says again where it is
_TRIGGER = """
import rclpy
from std_srvs.srv import Trigger
rclpy.init()
node = rclpy.create_node('bare')
node.create_service(Trigger, 'bare', lambda request, response: response)
rclpy.spin(node)
"""


def fault(
    chain: SerialChain, rng: np.random.Generator, count: int, checker: CollisionChecker | None
) -> tuple[list[Goal], dict[str, float], Array, Array]:
    """Draw goals that the locked arm can reach, the locked joint, and a moving start state."""
    joint = int(rng.integers(chain.n))
    middle, half = 0.5 * (chain.lower + chain.upper), 0.5 * (chain.upper - chain.lower)

    def draw(share: float) -> Array:
        return middle + share * half * rng.uniform(-1.0, 1.0, chain.n)

    start = draw(0.8)
    while checker is not None and checker.touches(start):
        start = draw(0.8)

    def posture() -> Array:
        while True:
            q = draw(1.0)
            q[joint] = start[joint]
            if checker is None or not checker.touches(q):
                return q

    goals = [Goal(fk(chain, posture())[1]) for _ in range(count)]
    speed = 0.3 * chain.velocity * rng.uniform(-1.0, 1.0, chain.n)
    speed[joint] = 0.0
    return goals, {chain.joint_names[joint]: float(start[joint])}, start, speed


def computation(name: str, chain: SerialChain, checker: CollisionChecker | None) -> None:
    """Print one row a number of goals."""
    settings = PlanSettings()
    warm_up(chain, settings)
    for count in GOALS:
        rng = np.random.default_rng(count)
        times, used, lengths = [], [], []
        unfinished: list[tuple[float, Any]] = []
        for _ in range(FAULTS):
            drawn = fault(chain, rng, count, checker)
            begin, worked = time.perf_counter(), time.process_time()
            plan = planned(chain, drawn, settings, checker)
            times.append(time.perf_counter() - begin)
            used.append(time.process_time() - worked)
            lengths.append(plan.trajectory.duration if plan.trajectory else 0.0)
            if plan.status != PlanStatus.FINISHES:
                unfinished.append((used[-1], drawn))
        p50, p99 = np.percentile(times, [50, 99]) * 1e3
        cpu50, cpu99 = np.percentile(used, [50, 99]) * 1e3
        finished = 100.0 * (1.0 - len(unfinished) / FAULTS)
        print(
            f'{name:22} {count:5} {FAULTS:7} {p50:8.2f} {p99:8.2f} {cpu50:8.2f} {cpu99:8.2f} '
            f'{finished:8.1f}% {np.mean(lengths):8.1f}',
            end='',
            flush=True,
        )
        if unfinished:
            others = [seconds for seconds, _ in unfinished]
            rest = np.percentile(sorted(set(used) - set(others)), 99) * 1e3
            print(
                f'   finished ones: cpu p99 {rest:.1f} ms; others: cpu p50 '
                f'{np.median(others) * 1e3:.0f} ms',
                end='',
            )
        if unfinished and checker is not None and chain.n - 1 <= MOST_JOINTS:
            doubted = [drawn for _, drawn in unfinished[:DOUBTED]]
            ways = [
                FreeSpace(chain, checker, frozen).connects(start, goals)
                for goals, frozen, start, _ in doubted
            ]
            print(f', {sum(ways)} of {len(ways)} have a way on a grid', end='')
        print(flush=True)


def planned(
    chain: SerialChain, drawn: Any, settings: PlanSettings, checker: CollisionChecker | None
) -> Plan:
    """Plan for what `fault` drew."""
    goals, frozen, start, speed = drawn
    return plan_task(
        chain,
        list(enumerate(goals)),
        frozen=frozen,
        sigma={},
        start=start,
        start_velocity=speed,
        settings=settings,
        checker=checker,
    )


def over_dds() -> None:
    """Print the time from a fault message to the plan as another process sees it."""
    from support.domain import free_domain

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


def run() -> None:
    """Print both tables."""
    print('computation; cpu: time on the processor, which other programs do not lengthen')
    print(f'{"":22} {"goals":>5} {"faults":>7} {"p50 ms":>8} {"p99 ms":>8} {"cpu p50":>8} '
          f'{"cpu p99":>8} {"finished":>9} {"plan s":>8}')  # fmt: skip
    table_3, panda = load_arm('paredis_table_3'), load_arm(PANDA, base=BASE, tip=TIP)
    computation('Table 3', table_3, None)
    computation('Panda', panda, None)
    computation('Table 3, collision', table_3, make_checker(
        table_3, 'paredis_table_3', None, CollisionOptions(link_radius=0.04)
    ))  # fmt: skip
    computation('Panda, collision', panda, make_checker(panda, PANDA, BASE, CollisionOptions()))
    print('\nover DDS, Table 3: fault message sent to plan received | computed in the node, with')
    print('its message | bare Trigger round trip in the same run')
    print(f'{"goals":>5} {"faults":>7} {"p50 ms":>9} {"p99 ms":>9} {"p50 ms":>9} {"p99 ms":>9} '
          f'{"p50 ms":>9} {"p99 ms":>9}')  # fmt: skip
    over_dds()
