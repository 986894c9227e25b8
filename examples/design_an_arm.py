"""Design an arm that finishes a task whichever joint locks, at whichever angle.

python examples/design_an_arm.py [ARM.yaml]
"""

import sys
from pathlib import Path

import numpy as np

from ft_manip_ros.core.arm_file import save_dh
from ft_manip_ros.core.design.candidate import Candidate
from ft_manip_ros.core.design.search import design_arm
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.task_file import load_task

HERE = Path(__file__).parent


def show(candidate: Candidate, best: Candidate) -> None:
    """Tell of every table that is better than those before."""
    if candidate is best:
        print(f'table {candidate.iteration}: penalty {candidate.penalty:.3g}')


def main() -> None:
    """Search, and write what was proved."""
    task = load_task(HERE / 'inspection_task.yaml')
    settings = DesignSettings(seed=1, time_budget=60.0)
    result = design_arm(task, settings=settings, on_candidate=show)
    print(f'{"proved" if result.proved else "NOT PROVED"}: {result.reason}')
    for joint, d, a, alpha in zip(
        result.table.joints, result.table.d, result.table.a, result.table.alpha, strict=True
    ):
        print(f'    {joint.name}: d {d:.3f} m, a {a:.3f} m, alpha {np.rad2deg(alpha):.1f} deg')
    if result.proved and len(sys.argv) > 1:
        save_dh(result.table, sys.argv[1])
        print(f'written to {sys.argv[1]}')


if __name__ == '__main__':
    main()
