"""Time to a proved design: the default search, the paper's, scipy's; random tasks; workers."""

from __future__ import annotations

import time

import numpy as np

from bench.design_rivals import RIVALS, search
from ft_manip_ros.core.design.problem import design_problem
from ft_manip_ros.core.design.search import design_arm
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.goal import DesignSpec, Goal, Task
from ft_manip_ros.core.task_file import load_task

SEEDS = 20
RIVAL_SEEDS = 5
BUDGET = 60.0
RANDOM_TASKS = 4
RANDOM_BUDGET = 40.0
LIMITS_DEG = (180, 150, 120)
POINTS = (3, 5, 10)
SEGMENTS = 80


def run() -> None:
    """Print the three tables."""
    task = load_task('paredis_eq_11')
    print("The paper's task (eq. 11), 5 joints, +-150 deg: time to a proved design, s.")
    print(
        f'  {"method":<26} {"proved":>8} {"median":>8} {"worst":>8} {"tables":>8} '
        f'{"evaluations":>12}'
    )
    # Compiling is set-up, not search.
    for method in ('worst_cases', 'annealing', 'paredis_1994'):
        design_arm(task, settings=DesignSettings(method=method, max_segments=1))
    for method, seeds, workers in (
        ('worst_cases', SEEDS, 2),
        ('worst_cases', SEEDS, 1),
        ('annealing', SEEDS, 2),
        ('paredis_1994', SEEDS, 2),
    ):
        rows = []
        for seed in range(seeds):
            settings = DesignSettings(
                method=method, seed=seed, workers=workers, time_budget=BUDGET
            )
            result = design_arm(task, settings=settings)
            rows.append((result.proved, result.elapsed, result.iterations, result.evaluations))
        print_row(f'{method}, {workers} workers', rows)
    problem = design_problem(task)
    for rival in RIVALS:
        rows = []
        for seed in range(RIVAL_SEEDS):
            found = search(problem, rival, seed, BUDGET)
            rows.append((found.proved, found.seconds, found.tables, found.evaluations))
        print_row(f'scipy {rival}', rows)
    random_tasks()
    speed_up(task)


def print_row(name: str, rows: list[tuple[bool, float, int, int]]) -> None:
    """Print one row: proved of all, median and worst time, median tables and evaluations."""
    proved, seconds, tables, evaluations = (np.array(column) for column in zip(*rows, strict=True))
    print(
        f'  {name:<26} {proved.sum():>3d} / {len(rows):<2d} {np.median(seconds):8.2f} '
        f'{seconds.max():8.2f} {np.median(tables):8.0f} {np.median(evaluations):12.0f}',
        flush=True,
    )


def random_tasks() -> None:
    """Random goals in a ball of 1 m, 5 joints."""
    print(f'\nRandom tasks: goals in a 1 m ball, 5 joints, budget {RANDOM_BUDGET:g} s, 2 workers.')
    print(f'  {"limits":>8} {"goals":>6} {"proved":>8} {"median s":>9} {"worst s":>8}')
    for limit in LIMITS_DEG:
        for points in POINTS:
            seconds, proved = [], 0
            for seed in range(RANDOM_TASKS):
                task, spec = random_task(seed, points, np.deg2rad(limit))
                settings = DesignSettings(seed=seed, workers=2, time_budget=RANDOM_BUDGET)
                result = design_arm(task, spec, settings)
                proved += result.proved
                seconds.append(result.elapsed)
            print(
                f'  {limit:>7}° {points:>6} {proved:>3d} / {RANDOM_TASKS:<2d} '
                f'{np.median(seconds):9.2f} {np.max(seconds):8.2f}',
                flush=True,
            )


def random_task(seed: int, points: int, limit: float) -> tuple[Task, DesignSpec]:
    """Goals drawn evenly from a ball of 1 m around the base."""
    rng = np.random.default_rng([seed, points])
    goals: list[Goal] = []
    while len(goals) < points:
        point = rng.uniform(-1.0, 1.0, 3)
        if np.linalg.norm(point) <= 1.0:
            goals.append(Goal(point, id=f'goal_{len(goals) + 1}'))
    return Task(f'random_{seed}', tuple(goals)), DesignSpec(5, 1, -limit, limit)


def speed_up(task: Task) -> None:
    """The same chains by one worker and by two; none ends early, so the work is the same."""
    print(f'\n{SEGMENTS} segments of a search that cannot succeed (3 joints), s.')
    spec = DesignSpec(3, 1, -2.6, 2.6)
    for executor in ('threads', 'processes'):
        seconds = []
        for workers in (1, 2):
            settings = DesignSettings(
                max_segments=SEGMENTS, workers=workers, executor=executor, time_budget=600.0
            )
            begin = time.perf_counter()
            design_arm(task, spec, settings)
            seconds.append(time.perf_counter() - begin)
        one, two = seconds
        print(f'  {executor:<10} 1: {one:6.2f}   2: {two:6.2f}   speed-up {one / two:.2f}')
