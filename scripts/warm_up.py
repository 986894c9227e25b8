"""Compile every numba kernel and import every module once, so that nodes start quickly.

Compiled code is kept in ``__pycache__`` beside the sources; without this, each of the processes
of a first demo or test would compile the same kernels at the same time. The same holds for the
bytecode of all packages that the nodes import.
"""

from __future__ import annotations

import importlib
import pkgutil
import sys
import time
from concurrent.futures import ProcessPoolExecutor

from stale_kernels import remove_stale

import ft_manip_ros
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.design import warm_up as design
from ft_manip_ros.core.design.problem import design_problem
from ft_manip_ros.core.detection import warm_up as detection
from ft_manip_ros.core.ftws import query as ftws
from ft_manip_ros.core.planning import warm_up as planning
from ft_manip_ros.core.planning.collision_setup import CollisionOptions, make_checker
from ft_manip_ros.core.planning.settings import PlanSettings
from ft_manip_ros.core.task_file import load_task


def compile_search() -> None:
    """Compile what the designer runs."""
    design.warm_up(design_problem(load_task('paredis_eq_11')))


def compile_the_rest() -> None:
    """Compile what the other nodes run, on the arm of the paper."""
    arm = load_arm('paredis_table_3')
    detection.warm_up()
    for mode in ('position', 'pose', 'dextrous'):
        ftws.warm_up(arm, mode=mode)
    planning.warm_up(arm, PlanSettings())
    make_checker(arm, arm.name, None, CollisionOptions(link_radius=0.04))


def import_everything() -> None:
    """Import all modules of the package, and so what they need; Python keeps the bytecode."""
    for module in pkgutil.walk_packages(ft_manip_ros.__path__, f'{ft_manip_ros.__name__}.'):
        importlib.import_module(module.name)


def main() -> None:
    """Run what the nodes run when they configure: two halves that share little, side by side."""
    start = time.monotonic()
    remove_stale()
    with ProcessPoolExecutor(max_workers=2) as pool:
        halves = [pool.submit(compile_search), pool.submit(compile_the_rest)]
        import_everything()
        for half in halves:
            half.result()
    elapsed = time.monotonic() - start
    if elapsed > 20.0:
        print(f'set-up: compiled kernels and bytecode in {elapsed:.0f} s', file=sys.stderr)


if __name__ == '__main__':
    main()
