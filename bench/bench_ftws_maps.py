"""FTWS maps: the volume of Table 1 between proved bounds, look-up time, memory."""

from __future__ import annotations

import time

import numpy as np

from ft_manip_ros.core.arm_file import load_dh
from ft_manip_ros.core.ftws.map_build import build_map
from ft_manip_ros.core.ftws.map_frame import map_frame
from ft_manip_ros.core.ftws.templates import VOLUME, in_template
from ft_manip_ros.core.ftws.verdict import Verdict

THREADS = 2


def run() -> None:
    """Volume of Table 1 with bounds, look-up time, memory."""
    chain = load_dh('paredis_table_1').chain()
    begin = time.perf_counter()
    made = build_map(
        chain, map_frame(chain, 'rz'), low=[0.0, -2.1], high=[2.1, 2.1], depth=10, threads=THREADS
    )
    took = time.perf_counter() - begin
    lower, upper = made.measure()
    print(
        f'volume of Table 1 proved between {lower:.4f} and {upper:.4f} '
        f'(middle {(lower + upper) / 2 / VOLUME - 1:+.3%} of 48.0845), '
        f'{made.grid.size} cells in {took:.0f} s, {made.grid.nbytes / 2**20:.2f} MiB of cells'
    )
    points = np.random.default_rng(2).uniform(-2.0, 2.0, (20_000, 3)).tolist()
    begin = time.perf_counter()
    answers = [made.lookup(point) for point in points]
    spent = (time.perf_counter() - begin) / len(points) * 1e6
    inside = in_template(np.array(points))
    false = sum(
        answer is (Verdict.NON_MEMBER if member else Verdict.MEMBER)
        for answer, member in zip(answers, inside, strict=True)
    )
    unknown = sum(answer is Verdict.UNDECIDED for answer in answers)
    print(
        f'look-up: {spent:.2f} us a point; of {len(points)} answers {false} are false and '
        f'{unknown} undecided'
    )
