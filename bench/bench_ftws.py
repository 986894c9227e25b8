"""FTWS: proved verdicts beside sampled ones, compiled and scripted with SciPy."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from bench.ftws_arms import limited
from bench.ftws_rivals import sampled_verdicts, scipy_verdict
from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.ftws.problem import Problem, goal_rows, prepare
from ft_manip_ros.core.ftws.query import judge_one, query, warm_up
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import Verdict

VERDICT = FtwsSettings(intervals=False)
THREADS = 2
SCIPY_POINTS = 3


def slice_points() -> Array:
    """27 x 21 points of the x-z half plane."""
    x, z = np.meshgrid(np.linspace(0.0, 2.6, 27), np.linspace(-2.0, 2.0, 21), indexing='ij')
    return np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)


def run() -> None:
    """Certified against sampled verdicts on slices of Table 1."""
    # CPU time, because wall time on a busy machine says little.
    print(f'27 x 21 slice of Table 1, {THREADS} threads; ms a point = CPU time / points / threads')
    print('limits   members  lost  open | proved: mean  median  p99 | sampled compiled  scipy')
    points = slice_points()
    for degrees in (180.0, 170.0, 160.0):
        chain = limited('paredis_table_1', degrees)
        warm_up(chain)
        problem = prepare(chain, 'position', 1)
        begin = time.process_time()
        answers = query(chain, points, settings=VERDICT, threads=THREADS)
        proved = (time.process_time() - begin) / len(points) / THREADS * 1e3
        spent = []
        for goal in goal_rows(points, 'position')[0]:
            begin = time.process_time()
            judge_one(problem, goal, VERDICT)
            spent.append(time.process_time() - begin)
        times = np.array(spent) * 1e3 / THREADS
        goals = np.zeros((len(points), 7))
        goals[:, :3], goals[:, 3] = points, 1.0
        verdicts = np.zeros(len(points), dtype=np.int64)
        sampled_verdicts(problem.arrays, problem.task, goals[:1], verdicts[:1])
        halves = [np.arange(i, len(points), THREADS) for i in range(THREADS)]

        def part(
            rows: NDArray[np.int64], goals: Array = goals, problem: Problem = problem
        ) -> NDArray[np.int64]:
            out = np.zeros(len(rows), dtype=np.int64)
            sampled_verdicts(problem.arrays, problem.task, goals[rows], out)
            return out

        begin = time.process_time()
        with ThreadPoolExecutor(THREADS) as pool:
            parts = list(pool.map(part, halves))
        sampled = (time.process_time() - begin) / len(points) / THREADS * 1e3
        for rows, out in zip(halves, parts, strict=True):
            verdicts[rows] = out
        some = np.linspace(0, len(points) - 1, SCIPY_POINTS + 2).astype(int)[1:-1]
        begin = time.process_time()
        for i in some:
            scipy_verdict(chain, points[i])
        scripted = (time.process_time() - begin) / len(some) / THREADS * 1e3
        count = [sum(a.verdict is v for a in answers) for v in Verdict]
        wrong = sum(
            a.verdict is Verdict.NON_MEMBER and v == 1
            for a, v in zip(answers, verdicts, strict=True)
        )
        print(
            f'±{degrees:3.0f}°  {count[0]:7d} {count[1]:5d} {count[2]:5d} | '
            f'{proved:12.3f} {np.median(times):7.3f} {np.quantile(times, 0.99):5.2f} | '
            f'{sampled:8.3f} (x{sampled / proved:.1f})'
            f' {scripted:9.1f} '
            f'(x{scripted / proved:.0f}); '
            f'sampling overlooks {wrong} lost points',
            flush=True,
        )
