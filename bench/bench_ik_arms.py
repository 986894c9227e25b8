"""IK of real arms with one joint locked, beside the libraries that people use for it.

The others are not dependencies: install those you want to compare with into the environment
(``pip install pin-pink daqp mink roboticstoolbox-python pytracik``).
"""

from __future__ import annotations

import time

import numpy as np

from bench.ik_rivals import PATIENCE, RIVALS, TOLERANCE, Rival, Solver
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.ik import solve_ik
from ft_manip_ros.core.ik_settings import IkSettings
from ft_manip_ros.core.kinematics import fk

PROBLEMS = 200
SEED = 6
_ROBOTS = 'package://example-robot-data/robots/'
ARMS = {
    'Panda': (_ROBOTS + 'panda_description/urdf/panda.urdf', 'panda_link0', 'panda_link8'),
    'xArm 7': (_ROBOTS + 'xarm_description/urdf/xarm7.urdf', 'link_base', 'link7'),
}
SETTINGS = IkSettings(tolerance=TOLERANCE, orientation_tolerance=TOLERANCE, restarts=1000)


def ours(chain: SerialChain, goal: Goal) -> Solver:
    """Set up the project's own IK, called from Python for one goal like the others."""
    assert chain.arrays is not None
    return lambda start: solve_ik(chain, goal, start=start, settings=SETTINGS).q


def reached(chain: SerialChain, goal: Goal, q: Array) -> bool:
    """Whether an answer is inside the limits and at the goal to ten times the tolerance."""
    slack = 1e-6
    if not ((q >= chain.lower - slack).all() and (q <= chain.upper + slack).all()):
        return False
    rotation, position = fk(chain, q)
    error = float(np.linalg.norm(position - goal.position))
    if goal.orientation is not None:
        error = max(error, float(np.linalg.norm(rotation - goal.orientation)))
    return error <= 10.0 * TOLERANCE


def problems(arm: SerialChain, with_pose: bool) -> list[tuple[SerialChain, Goal, Array]]:
    """RODs with one joint frozen anywhere in its range, goals that they reach, cold starts."""
    rng = np.random.default_rng(SEED)
    made = []
    for _ in range(PROBLEMS):
        q, start = rng.uniform(arm.lower, arm.upper, (2, arm.n))
        j = int(rng.integers(arm.n))
        rod = arm.freeze({arm.joint_names[j]: q[j]})
        rotation, position = fk(arm, q)
        made.append((rod, Goal(position, rotation if with_pose else None), np.delete(start, j)))
    return made


def run() -> None:
    """Print one table for each arm and kind of goal."""
    for arm_name, (url, base, tip) in ARMS.items():
        arm = load_arm(url, base=base, tip=tip)
        for with_pose in (False, True):
            given = problems(arm, with_pose)
            solve_ik(given[0][0], given[0][1])
            print(
                f'{arm_name}, one joint locked, {"pose" if with_pose else "position"}, '
                f'{PROBLEMS} reachable goals, cold start, {TOLERANCE:g} m and rad, '
                f'at most {PATIENCE:g} s'
            )
            print(f'{"":28}{"success %":>10}{"mean us":>11}{"median us":>11}{"ratio":>9}')
            first = None
            for name, rival in {'ft_manip_ros': Rival('ft_manip_ros', ours), **RIVALS}.items():
                if why := rival.skipped(with_pose=with_pose):
                    print(f'{name:28} skipped: {why}')
                    continue
                good, spent = 0, []
                for rod, goal, start in given:
                    solver = rival.set_up(rod, goal)
                    begin = time.perf_counter()
                    q = solver(start)
                    spent.append(time.perf_counter() - begin)
                    good += reached(rod, goal, q)
                mean = float(np.mean(spent)) * 1e6
                first = mean if first is None else first
                print(
                    f'{name:28}{100.0 * good / PROBLEMS:10.1f}{mean:11.1f}'
                    f'{float(np.median(spent)) * 1e6:11.1f}{mean / first:9.1f}',
                    flush=True,
                )
            print()
