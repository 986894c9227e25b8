"""FTWS verdicts: how their cost grows with joints, order and tolerance."""

from __future__ import annotations

import time

import numpy as np

from bench.ftws_arms import planar, spatial
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.ftws.query import query, warm_up
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import Verdict

_POINTS = 40


def run() -> None:
    """Time against joints, order and tolerance."""
    print('mean ms of CPU a member / a point within 1.5 times the reach, one thread')
    rng = np.random.default_rng(1)
    rows: list[tuple[str, SerialChain, int, float]] = []
    rows += [(f'spatial {n}R, order 1', spatial(n), 1, 1e-6) for n in range(5, 10)]
    rows += [(f'planar {n}R, order 1', planar(*[1.0] * n), 1, 1e-6) for n in range(4, 10)]
    rows += [
        (f'planar {2 * k + 2}R, order {k}', planar(*[1.0] * (2 * k + 2)), k, 1e-6)
        for k in (2, 3, 4)
    ]
    rows += [('spatial 5R, tolerance 1e-3', spatial(5), 1, 1e-3)]
    rows += [('spatial 5R, tolerance 1e-9', spatial(5), 1, 1e-9)]
    for name, chain, order, tolerance in rows:
        points = rng.uniform(-1.0, 1.0, (_POINTS, 3)) * [
            1.4,
            1.4,
            0.0 if 'planar' in name else 1.4,
        ]
        settings = FtwsSettings(intervals=False, tolerance=tolerance)
        warm_up(chain, order=order)
        members, everything, open_count = [], [], 0
        for point in points:
            begin = time.thread_time()
            answer = query(chain, point[None], order=order, settings=settings)[0]
            everything.append(time.thread_time() - begin)
            if answer.verdict is Verdict.MEMBER:
                members.append(everything[-1])
            open_count += answer.verdict is Verdict.UNDECIDED
        mean = f'{np.mean(members) * 1e3:9.2f}' if members else '        -'
        print(
            f'{name:<28} {mean} / {np.mean(everything) * 1e3:9.2f}   '
            f'({len(members)} members, {open_count} undecided of {_POINTS})',
            flush=True,
        )
