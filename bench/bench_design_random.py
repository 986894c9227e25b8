"""Random tasks: 3, 5 and 10 points in a ball of 1 m, under three sets of limits."""

from __future__ import annotations

import numpy as np

from ft_manip_ros.core.design.search import design_arm
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.goal import DesignSpec, Goal, Task

TASKS = 4
BUDGET = 60.0
SMALL_BUDGET = 5.0
LIMITS_DEG = (180, 150, 120)
POINTS = (3, 5, 10)


def run() -> None:
    """Print the table, for five joints and for four."""
    random_tasks(5, LIMITS_DEG, POINTS, BUDGET)
    random_tasks(4, (180, 150), (3,), SMALL_BUDGET)


def random_tasks(
    dof: int, limits: tuple[int, ...], points: tuple[int, ...], budget: float
) -> None:
    """Design for random goals; one row for every limit and number of points."""
    print(f'\nRandom tasks: goals in a 1 m ball, {dof} joints, budget {budget:g} s, 2 workers.')
    print(f'  {"limits":>8} {"goals":>6} {"proved":>8} {"median s":>9} {"worst s":>8}')
    for limit in limits:
        for count in points:
            seconds, proved = [], 0
            for seed in range(TASKS):
                task, spec = random_task(seed, count, np.deg2rad(limit), dof)
                settings = DesignSettings(seed=seed, workers=2, time_budget=budget)
                result = design_arm(task, spec, settings)
                proved += result.proved
                seconds.append(result.elapsed)
            print(
                f'  {limit:>7}° {count:>6} {proved:>3d} / {TASKS:<2d} '
                f'{np.median(seconds):9.2f} {np.max(seconds):8.2f}',
                flush=True,
            )


def random_task(seed: int, points: int, limit: float, dof: int) -> tuple[Task, DesignSpec]:
    """Goals drawn evenly from a ball of 1 m around the base."""
    rng = np.random.default_rng([seed, points])
    goals: list[Goal] = []
    while len(goals) < points:
        point = rng.uniform(-1.0, 1.0, 3)
        if np.linalg.norm(point) <= 1.0:
            goals.append(Goal(point, id=f'goal_{len(goals) + 1}'))
    return Task(f'random_{seed}', tuple(goals)), DesignSpec(dof, 1, -limit, limit)
