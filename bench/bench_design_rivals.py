"""The search of 1994 and scipy's optimisers on the same objective, with the same proof."""

from __future__ import annotations

from bench.design_rivals import RIVALS, search
from bench.design_runs import compile_method, print_head, print_row, search_seeds
from ft_manip_ros.core.design.problem import design_problem
from ft_manip_ros.core.task_file import load_task

SEEDS = 3
BUDGET = 20.0


def run() -> None:
    """Print the table."""
    task = load_task('paredis_eq_11')
    print(f"The paper's task (eq. 11), 5 joints, +-150 deg; budget {BUDGET:g} s a seed.")
    print_head()
    for method, workers in (('worst_cases', 1), ('annealing', 1), ('paredis_1994', 1)):
        compile_method(task, method)
        rows = search_seeds(task, method, SEEDS, workers, BUDGET)
        print_row(f'{method}, {workers} worker', rows)
    problem = design_problem(task)
    for rival in RIVALS:
        found = [search(problem, rival, seed, BUDGET) for seed in range(SEEDS)]
        rows = [(one.proved, one.seconds, one.tables, one.evaluations) for one in found]
        print_row(f'scipy {rival}', rows)
