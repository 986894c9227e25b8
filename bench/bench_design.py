"""Time to a proved design on the paper's task, 20 seeds, and what the verifier confirms."""

from __future__ import annotations

import time

from bench.design_runs import compile_method, print_head, print_row, search_seeds
from ft_manip_ros.core.arm_file import load_dh
from ft_manip_ros.core.design.certificate import certify_design
from ft_manip_ros.core.design.search import design_arm
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.task_file import load_task

SEEDS = 20
BUDGET = 60.0


def run() -> None:
    """Print both tables."""
    task = load_task('paredis_eq_11')
    print("The paper's task (eq. 11), 5 joints, +-150 deg: time to a proved design.")
    print_head()
    for method, workers in (('worst_cases', 2), ('worst_cases', 1), ('annealing', 2)):
        compile_method(task, method)
        rows = search_seeds(task, method, SEEDS, workers, BUDGET)
        print_row(f'{method}, {workers} workers', rows)
    confirmed, begin = 0, time.process_time()
    for seed in range(SEEDS):
        table = design_arm(task, settings=DesignSettings(seed=seed)).table
        confirmed += all(ok for ok, _ in certify_design(table.chain(), task, 1)[1])
    spent = (time.process_time() - begin) / SEEDS
    print(
        f'\nCertificates of the {SEEDS} designs of worst_cases that the independent verifier '
        f'confirms: {confirmed} / {SEEDS}, {spent:.2f} s of CPU each, search included.'
    )
    known = certify_design(load_dh('paredis_table_3').chain(), task, 1)[1]
    print(f'Table 3: {sum(ok for ok, _ in known)} of {len(known)} goals confirmed.')
