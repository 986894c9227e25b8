"""FTWS: proved verdicts beside sampled ones, growth with joints and order, maps."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from bench.ftws_arms import limited, planar, spatial
from bench.ftws_rivals import sampled_verdicts, scipy_verdict
from ft_manip_ros.core.arm_file import load_dh
from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.ftws.map_build import build_map
from ft_manip_ros.core.ftws.map_frame import map_frame
from ft_manip_ros.core.ftws.problem import Problem, goal_rows, prepare
from ft_manip_ros.core.ftws.query import judge_one, query, warm_up
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.templates import VOLUME
from ft_manip_ros.core.ftws.verdict import Verdict

VERDICT = FtwsSettings(intervals=False)
THREADS = 2
SCIPY_POINTS = 3


def run() -> None:
    """Print all tables."""
    slices()
    growth()
    maps()


def slice_points() -> Array:
    """27 x 21 points of the x-z half plane."""
    x, z = np.meshgrid(np.linspace(0.0, 2.6, 27), np.linspace(-2.0, 2.0, 21), indexing='ij')
    return np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)


def slices() -> None:
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


def growth() -> None:
    """Time against joints, order and tolerance."""
    print('\nmean ms a member / a point within 1.5 times the reach, one thread')
    rng = np.random.default_rng(1)
    rows: list[tuple[str, SerialChain, int, float]] = []
    rows += [(f'spatial {n}R, order 1', spatial(n), 1, 1e-6) for n in range(5, 10)]
    rows += [(f'planar {n}R, order 1', planar(*[1.0] * n), 1, 1e-6) for n in range(4, 10)]
    rows += [
        (f'planar {2 * k + 2}R, order {k}', planar(*[1.0] * (2 * k + 2)), k, 1e-6) for k in (2, 3)
    ]
    rows += [('spatial 5R, tolerance 1e-3', spatial(5), 1, 1e-3)]
    rows += [('spatial 5R, tolerance 1e-9', spatial(5), 1, 1e-9)]
    for name, chain, order, tolerance in rows:
        count = {1: 40, 2: 3}.get(order, 1)
        points = rng.uniform(-1.0, 1.0, (count, 3)) * [1.4, 1.4, 0.0 if 'planar' in name else 1.4]
        pieces = 100_000 if order < 3 else 20_000
        settings = FtwsSettings(intervals=False, tolerance=tolerance, pieces=pieces)
        answers = query(chain, points, order=order, settings=settings)
        members = [a.elapsed_s for a in answers if a.verdict is Verdict.MEMBER]
        everything = [a.elapsed_s for a in answers]
        open_count = sum(a.verdict is Verdict.UNDECIDED for a in answers)
        mean = f'{np.mean(members) * 1e3:9.2f}' if members else '        -'
        print(
            f'{name:<28} {mean} / {np.mean(everything) * 1e3:9.2f}   '
            f'({len(members)} members, {open_count} undecided of {count})',
            flush=True,
        )


def maps() -> None:
    """Volume of Table 1 with bounds, look-up time, memory."""
    chain = load_dh('paredis_table_1').chain()
    begin = time.perf_counter()
    made = build_map(
        chain, map_frame(chain, 'rz'), low=[0.0, -2.5], high=[2.5, 2.5], depth=10, threads=THREADS
    )
    took = time.perf_counter() - begin
    lower, upper = made.measure()
    print(
        f'\nvolume of Table 1 proved between {lower:.4f} and {upper:.4f} '
        f'(middle {(lower + upper) / 2 / VOLUME - 1:+.3%} of 48.0845), '
        f'{made.grid.size} cells in {took:.0f} s, {made.grid.nbytes / 2**20:.2f} MiB of cells'
    )
    points = np.random.default_rng(2).uniform(-2.0, 2.0, (20_000, 3)).tolist()
    begin = time.perf_counter()
    for point in points:
        made.lookup(point)
    print(f'look-up: {(time.perf_counter() - begin) / len(points) * 1e6:.2f} us a point')
