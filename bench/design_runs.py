"""What the benchmarks of the design search share: one run, and a row of a table."""

from __future__ import annotations

import numpy as np

from ft_manip_ros.core.design.search import design_arm
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.goal import Task

Row = tuple[bool, float, int, int]


def print_head() -> None:
    """Print the head of a table of `print_row`."""
    print(
        f'  {"method":<26} {"proved":>8} {"median s":>8} {"worst s":>8} {"tables":>8} '
        f'{"evaluations":>12}'
    )


def print_row(name: str, rows: list[Row]) -> None:
    """Print one row: proved of all, median and worst time, median tables and evaluations."""
    proved, seconds, tables, evaluations = (np.array(column) for column in zip(*rows, strict=True))
    print(
        f'  {name:<26} {proved.sum():>3d} / {len(rows):<2d} {np.median(seconds):8.2f} '
        f'{seconds.max():8.2f} {np.median(tables):8.0f} {np.median(evaluations):12.0f}',
        flush=True,
    )


def compile_method(task: Task, method: str) -> None:
    """Compile (or load) a method: that is set-up, not search."""
    design_arm(task, settings=DesignSettings(method=method, max_segments=1))


def search_seeds(task: Task, method: str, seeds: int, workers: int, budget: float) -> list[Row]:
    """Search with seeds 0, 1, ...; one row each."""
    rows = []
    for seed in range(seeds):
        settings = DesignSettings(method=method, seed=seed, workers=workers, time_budget=budget)
        found = design_arm(task, settings=settings)
        rows.append((found.proved, found.elapsed, found.iterations, found.evaluations))
    return rows
