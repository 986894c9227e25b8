"""Speed-up from one worker to two, on work that is the same for both."""

from __future__ import annotations

import time

from ft_manip_ros.core.design.search import design_arm
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.goal import DesignSpec, Task
from ft_manip_ros.core.task_file import load_task

# Segments of each method: some seconds of work for one worker.
SEGMENTS = {'worst_cases': 80, 'annealing': 24, 'paredis_1994': 24}


def run() -> None:
    """Print the table. Wall times: only a machine with nothing else to do shows the speed-up."""
    task = load_task('paredis_eq_11')
    print('Chains of a search that cannot succeed (3 joints), by 1 worker and by 2, s.')
    for method, segments in SEGMENTS.items():
        for executor in ('threads', 'processes'):
            one, two = (elapsed(task, method, segments, executor, n) for n in (1, 2))
            print(
                f'  {method:<14} {segments:>3d} segments, {executor:<10} 1: {one:6.2f}   '
                f'2: {two:6.2f}   speed-up {one / two:.2f}',
                flush=True,
            )


def elapsed(task: Task, method: str, segments: int, executor: str, workers: int) -> float:
    """Time of one search, loading of kernels in worker processes included."""
    spec = DesignSpec(3, 1, -2.6, 2.6)
    settings = DesignSettings(
        method=method,
        max_segments=segments,
        workers=workers,
        executor=executor,
        time_budget=600.0,
    )
    begin = time.perf_counter()
    design_arm(task, spec, settings)
    return time.perf_counter() - begin
