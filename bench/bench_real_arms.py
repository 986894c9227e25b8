"""Eleven real arms: each joint locked at five angles, twenty goals, every plan replayed.

Plans through positions are replayed to the last goal, the others to their fourth.
"""

from __future__ import annotations

import sys
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from bench.recovery_sweep import Tally, sweep
from ft_manip_ros.core.arm_file import load_arm

sys.path.append(str(Path(__file__).parents[1] / 'test'))
from support.chains import REAL_ARMS

ANGLES, GOALS, SEED = 5, 20, 7
PROCESSES = 2
CASES = (
    ('positions the locked arm can reach', False, False, GOALS),
    ('poses the locked arm can reach', True, False, 4),
    ('positions the healthy arm can reach', False, True, 4),
)


def row(arm: str, poses: bool, healthy_goals: bool, replayed: int) -> tuple[Tally, float]:
    """Sweep one arm; returns the tally and the time it took (s)."""
    urdf, base, tip, _ = REAL_ARMS[arm]
    begin = time.perf_counter()
    chain = load_arm(urdf, base=base, tip=tip)
    tally = sweep(
        chain,
        angles=ANGLES,
        goals=GOALS,
        poses=poses,
        healthy_goals=healthy_goals,
        seed=SEED,
        replayed=replayed,
    )
    return tally, time.perf_counter() - begin


def run() -> None:
    """Print one table a kind of goal."""
    with ProcessPoolExecutor(PROCESSES) as pool:
        for title, poses, healthy_goals, replayed in CASES:
            print(f'\n{title}: each joint x {ANGLES} angles x {GOALS} goals')
            print(
                f'{"arm":8} {"goals":>6} {"reached":>8} {"lost":>6} {"open":>5} {"replayed":>9} '
                f'{"arrived":>8} {"worst mm":>9} {"speed":>6} {"accel":>6} {"jerk":>6} {"s":>5}'
            )
            jobs = {
                arm: pool.submit(row, arm, poses, healthy_goals, replayed) for arm in REAL_ARMS
            }
            for arm, job in jobs.items():
                t, took = job.result()
                print(
                    f'{arm:8} {t.goals:6} {t.reachable:8} {t.lost:6} {t.undecided:5} '
                    f'{t.replayed:9} {t.arrived:8} {t.tool_error * 1e3:9.4f} {t.speed:6.3f} '
                    f'{t.acceleration:6.3f} {t.jerk:6.3f} {took:5.0f}',
                    flush=True,
                )
    print('\nlost: proved; open: neither posture nor proof within the budget; replayed: goals of')
    print('the plans, in the simulated arm, joint locked; arrived: within 1 mm (and 0.01 rad)')
    print('0.19 s after the planned arrival; speed, accel, jerk: largest share of the limit.')
