"""Fault to plan: how long the computation takes, by number of goals, with and without bodies."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from bench.free_space import MOST_JOINTS, FreeSpace
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.collision_setup import CollisionOptions, make_checker
from ft_manip_ros.core.planning.plan import Plan, PlanStatus
from ft_manip_ros.core.planning.replan import plan_task
from ft_manip_ros.core.planning.settings import PlanSettings
from ft_manip_ros.core.planning.warm_up import warm_up

FAULTS = 500
# Of so many tasks that were not finished it is looked up whether there is a way.
DOUBTED = 8
GOALS = (3, 10, 50)
PANDA = 'package://example-robot-data/robots/panda_description/urdf/panda.urdf'
BASE, TIP = 'panda_link0', 'panda_link8'


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


def run() -> None:
    """Print the table."""
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
