"""FTWS: proved verdicts beside sampled ones: compiled, with SciPy, with IK libraries."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from bench.ftws_arms import limited
from bench.ftws_rivals import library_verdict, sampled_verdicts, scipy_verdict
from bench.ik_rivals import RIVALS
from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.ftws.problem import Problem, goal_rows, prepare
from ft_manip_ros.core.ftws.query import judge_one, query, warm_up
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import FtwsResult, Verdict

VERDICT = FtwsSettings(intervals=False)
THREADS = 2
BATCHES = 3
# Points of the slice for the slow ones: a member, one at the edge, one that is lost.
SLOW_POINTS = ((0.6, 0.4), (1.8, 0.6), (2.0, 1.4))


def slice_points() -> Array:
    """27 x 21 points of the x-z half plane."""
    x, z = np.meshgrid(np.linspace(0.0, 2.6, 27), np.linspace(-2.0, 2.0, 21), indexing='ij')
    return np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)


def run() -> None:
    """Certified against sampled verdicts on slices of Table 1."""
    print('27 x 21 slice of Table 1. Proved: CPU ms a point, one by one on one thread; wall ms a')
    print(f'point of the slice as one query, {THREADS} threads (best of {BATCHES}).')
    print('Sampled: CPU ms a point, compiled (x: proved / sampled) and with SciPy.')
    print('limits  members lost open |  mean median   p99 | 2 threads | compiled         | SciPy')
    for degrees in (180.0, 170.0, 160.0):
        _row(degrees)
    libraries(limited('paredis_table_1', 170.0))


def libraries(chain: SerialChain) -> None:
    """Sampled verdicts with the IK libraries that are installed."""
    warm_up(chain)
    print(f'On {len(SLOW_POINTS)} points at ±170°, CPU s a point, RODs set up beforehand:')
    problem = prepare(chain, 'position', 1)
    rows = goal_rows(_slow(), 'position')[0]
    begin = time.process_time()
    for row in rows:
        judge_one(problem, row, VERDICT)
    proved = (time.process_time() - begin) / len(rows)
    print(f'    proved                  {proved:9.4f}')
    for name, rival in RIVALS.items():
        if why := rival.skipped(with_pose=False):
            print(f'    {name:<23} skipped: {why}')
            continue
        answers = [library_verdict(chain, point, rival.set_up) for point in _slow()]
        spent = sum(seconds for _, seconds in answers) / len(answers)
        found = [verdict for verdict, _ in answers]
        print(f'    {name:<23} {spent:9.4f} (x{spent / proved:.0f}), verdicts {found}', flush=True)


def _slow() -> Array:
    return np.array([[x, 0.0, z] for x, z in SLOW_POINTS])


def _row(degrees: float) -> None:
    """Judge the slice at one limit, by all but the libraries."""
    points = slice_points()
    chain = limited('paredis_table_1', degrees)
    warm_up(chain)
    problem = prepare(chain, 'position', 1)
    wall, answers = _batch(chain, points)
    spent = []
    for goal in goal_rows(points, 'position')[0]:
        begin = time.thread_time()
        judge_one(problem, goal, VERDICT)
        spent.append(time.thread_time() - begin)
    times = np.array(spent) * 1e3
    verdicts, sampled = _sampled(problem, points)
    begin = time.process_time()
    for point in _slow():
        scipy_verdict(chain, point)
    scripted = (time.process_time() - begin) / len(SLOW_POINTS) * 1e3
    begin = time.process_time()
    for goal in goal_rows(_slow(), 'position')[0]:
        judge_one(problem, goal, VERDICT)
    same = (time.process_time() - begin) / len(SLOW_POINTS) * 1e3
    count = [sum(a.verdict is v for a in answers) for v in Verdict]
    wrong = sum(
        a.verdict is Verdict.NON_MEMBER and v == 1 for a, v in zip(answers, verdicts, strict=True)
    )
    print(
        f'±{degrees:3.0f}°   {count[0]:6d} {count[1]:4d} {count[2]:4d} | {times.mean():5.3f} '
        f'{np.median(times):6.3f} {np.quantile(times, 0.99):5.2f} | {wall:9.3f} | '
        f'{sampled:8.3f} (x{times.mean() / sampled:.2f}) | {scripted:8.1f} '
        f'(x{scripted / times.mean():.0f}; x{scripted / same:.0f} on its own points); '
        f'sampling overlooks {wrong} lost points',
        flush=True,
    )


def _batch(chain: SerialChain, points: Array) -> tuple[float, list[FtwsResult]]:
    """Wall ms a point of the slice as one query, and its answers."""
    best = np.inf
    for _ in range(BATCHES):
        begin = time.perf_counter()
        answers = query(chain, points, settings=VERDICT, threads=THREADS)
        best = min(best, time.perf_counter() - begin)
    return best / len(points) * 1e3, answers


def _sampled(problem: Problem, points: Array) -> tuple[NDArray[np.int64], float]:
    """Compiled sampled verdicts and their CPU ms a point."""
    goals = np.zeros((len(points), 7))
    goals[:, :3], goals[:, 3] = points, 1.0
    verdicts = np.zeros(len(points), dtype=np.int64)
    sampled_verdicts(problem.arrays, problem.task, goals[:1], verdicts[:1])
    begin = time.thread_time()
    sampled_verdicts(problem.arrays, problem.task, goals, verdicts)
    return verdicts, (time.thread_time() - begin) / len(points) * 1e3
