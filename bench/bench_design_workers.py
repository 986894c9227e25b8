"""Speed-up from one worker to two, on work that is the same for both."""

from __future__ import annotations

import time

from ft_manip_ros.core.design.chains import ChainSearch
from ft_manip_ros.core.design.problem import DesignProblem, design_problem
from ft_manip_ros.core.design.segments import never
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.design.warm_up import warm_up
from ft_manip_ros.core.design.workers import open_workers
from ft_manip_ros.core.goal import DesignSpec, Task
from ft_manip_ros.core.task_file import load_task

# Segments of each method: some seconds of work for one worker.
SEGMENTS = {'worst_cases': 80, 'annealing': 24, 'paredis_1994': 24}
# Segments given to each worker before the clock starts, so that it has loaded its kernels.
WARMING = 4


def run() -> None:
    """Print the table. Wall times: only a machine with nothing else to do shows the speed-up."""
    task = load_task('paredis_eq_11')
    print(
        'Chains of a search that cannot succeed (3 joints), by 1 worker and by 2, s of wall time:'
    )
    print('from workers that run already (warm), and with their start and loading of kernels.')
    for method, segments in SEGMENTS.items():
        for executor in ('threads', 'processes'):
            one, two = (elapsed(task, method, segments, executor, n) for n in (1, 2))
            words = [
                f'{name} 1: {a:6.2f}  2: {b:6.2f}  speed-up {a / b:.2f}'
                for name, a, b in zip(('warm', 'with start'), one, two, strict=True)
            ]
            print(f'  {method:<12} {segments:>3d} segments, {executor:<9}  {"   ".join(words)}',
                  flush=True)  # fmt: skip


def elapsed(
    task: Task, method: str, segments: int, executor: str, count: int
) -> tuple[float, float]:
    """Time of one search: from warm workers, and with their start."""
    spec = DesignSpec(3, 1, -2.6, 2.6)
    settings = DesignSettings(
        method=method, max_segments=segments, workers=count, executor=executor, time_budget=600.0
    )
    problem = design_problem(task, spec, settings)
    warm_up(problem)
    cold = search(problem, warm=False)
    return search(problem, warm=True), cold


def search(problem: DesignProblem, *, warm: bool) -> float:
    """Time of one search (s)."""
    begin = time.perf_counter()
    workers = open_workers(problem)
    try:
        if warm:
            slots = range(WARMING * problem.settings.workers)
            futures = [workers.submit(problem, slot, 0, None, 600.0, never) for slot in slots]
            for future in futures:
                future.result()
            begin = time.perf_counter()
        ChainSearch(problem, None, never, None).run(workers)
        return time.perf_counter() - begin
    finally:
        workers.close()
