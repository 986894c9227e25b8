"""Larger designs: six joints, full poses with eight, and two failures at once with seven."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ft_manip_ros.core.design.certificate import certify_design
from ft_manip_ros.core.design.search import design_arm
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.goal import DesignSpec, Task, rotation_from_quaternion
from ft_manip_ros.core.task_file import load_task

LIMIT = np.deg2rad(150.0)


def run() -> None:
    """Print one line a search."""
    task = load_task('paredis_eq_11')
    print('Points of eq. 11; a certificate is confirmed by the independent verifier.')
    for seed in range(4):
        report('6 joints, order 1, +-150 deg', task, DesignSpec(6, 1, -LIMIT, LIMIT), seed, 20.0)
    for seed in range(3):
        report('8 joints, order 1, full poses', posed(task, seed), DesignSpec(8), seed, 20.0)
    for seed in range(3):
        report('7 joints, order 2, no limits', task, DesignSpec(7, 2), seed, 25.0)


def posed(task: Task, seed: int) -> Task:
    """Return the task with a random orientation at each of its points."""
    quaternions = np.random.default_rng([seed, 8]).normal(size=(len(task.goals), 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    goals = tuple(
        replace(goal, orientation=rotation_from_quaternion(q, 'orientation'))
        for goal, q in zip(task.goals, quaternions, strict=True)
    )
    return Task(f'{task.name}_posed', goals)


def report(name: str, task: Task, spec: DesignSpec, seed: int, budget: float) -> None:
    """Search once and print what came of it."""
    settings = DesignSettings(seed=seed, workers=2, time_budget=budget)
    result = design_arm(task, spec, settings)
    word = 'proved' if result.proved else 'NOT PROVED'
    text = f'  {name:<30} seed {seed}: {word:<10} {result.elapsed:6.1f} s'
    if result.proved:
        outcomes = certify_design(result.table.chain(), task, spec.order)[1]
        text += f', {sum(ok for ok, _ in outcomes)} of {len(outcomes)} goals confirmed'
    if not result.proved:
        text += f'; {result.reason}'
    print(text, flush=True)
