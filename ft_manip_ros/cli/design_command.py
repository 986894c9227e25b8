"""`ftmanip design`: search for an arm that reaches a task whichever joint locks."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from tqdm import tqdm

from ft_manip_ros.core.arm_file import save_dh
from ft_manip_ros.core.design.candidate import Candidate, DesignResult
from ft_manip_ros.core.design.search import design_arm
from ft_manip_ros.core.design.settings import METHODS, DesignSettings
from ft_manip_ros.core.design.space import FAMILIES
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import DesignSpec, Task
from ft_manip_ros.core.task_file import load_task


def add_parser(subparsers: Any) -> None:
    """Add the sub-command."""
    defaults = DesignSettings()
    parser = subparsers.add_parser(
        'design',
        help='design an arm that reaches a task whatever joint locks',
        description='Search for a DH table whose fault-tolerant work space contains every goal '
        'of a task, and prove it. Ctrl-C ends the search with its best design.',
    )
    parser.add_argument('task', help='task file, or its name in config/tasks')
    parser.add_argument('--dof', type=int, help='number of joints')
    parser.add_argument('--order', type=int, help='joints that fail at once')
    parser.add_argument(
        '--limits-deg', nargs=2, type=float, metavar=('LOWER', 'UPPER'),
        help='limits of every joint',
    )  # fmt: skip
    parser.add_argument('--method', choices=METHODS, default=defaults.method)
    parser.add_argument('--seed', type=int, default=defaults.seed)
    parser.add_argument(
        '--time-budget', type=float, default=defaults.time_budget, help='when to give up (s)'
    )
    parser.add_argument('--workers', type=int, default=1, help='segments searched side by side')
    parser.add_argument(
        '--margin', type=float, default=defaults.margin,
        help="room around every goal, as a share of the farthest goal's distance",
    )  # fmt: skip
    parser.add_argument(
        '--alpha-step-deg', type=float, default=0.0, help='alpha is a multiple of this'
    )
    parser.add_argument('--family', choices=FAMILIES, default=defaults.family)
    parser.add_argument('--max-length', type=float, help='longest sum of link lengths (m)')
    parser.add_argument(
        '--bound', nargs=3, action='append', default=[], metavar=('PARAMETER', 'LOWER', 'UPPER'),
        help='range of d, a or alpha, or of one parameter (a_3); m and deg',
    )  # fmt: skip
    parser.add_argument(
        '--fix', nargs=2, action='append', default=[], metavar=('PARAMETER', 'VALUE'),
        help='value of one parameter, e.g. alpha_2 90; m and deg',
    )  # fmt: skip
    parser.add_argument('--output', help='arm file to write the design to')
    parser.add_argument('--force', action='store_true', help='overwrite the output')
    parser.add_argument('--json', action='store_true', help='print the result as JSON')


def run(args: argparse.Namespace) -> int:
    """Search, print, write; exit code 1 where nothing was proved."""
    task = load_task(args.task)
    spec = specification(args, task)
    settings = DesignSettings(
        method=args.method,
        seed=args.seed,
        time_budget=args.time_budget,
        workers=args.workers,
        margin=args.margin,
        alpha_step=float(np.deg2rad(args.alpha_step_deg)),
        family=args.family,
        max_length=np.inf if args.max_length is None else args.max_length,
        bounds={
            name: (_value('bound', name, lower), _value('bound', name, upper))
            for name, lower, upper in args.bound
        },
        fixed={name: _value('fix', name, value) for name, value in args.fix},
    )
    if args.output and os.path.exists(args.output) and not args.force:
        raise InputError('--output', f'{args.output} exists; --force overwrites it')
    with _ctrl_c() as stop, _Progress(settings) as progress:
        result = design_arm(
            task, spec, settings, on_candidate=progress.show, should_stop=stop.is_set
        )
    if args.output:
        save_dh(result.table, args.output)
    print(json.dumps(to_json(task, spec, settings, result)) if args.json else describe(result))
    return 0 if result.proved else 1


def specification(args: argparse.Namespace, task: Task) -> DesignSpec:
    """Return what to design: the options where given, else the task's design section."""
    if task.design is None and args.dof is None:
        raise InputError('--dof', f'is needed: task {task.name!r} has no design section')
    spec = task.design or DesignSpec(args.dof)
    if args.limits_deg is not None:
        lower, upper = np.deg2rad(args.limits_deg)
        spec = replace(spec, lower=float(lower), upper=float(upper))
    dof = spec.dof if args.dof is None else args.dof
    order = spec.order if args.order is None else args.order
    return replace(spec, dof=dof, order=order)


def to_json(
    task: Task, spec: DesignSpec, settings: DesignSettings, result: DesignResult
) -> dict[str, Any]:
    """Return the result as the command prints it with --json; lengths in m, angles in rad."""
    return {
        'task': task.name,
        'dof': spec.dof,
        'order': spec.order,
        'method': settings.method,
        'seed': settings.seed,
        'proved': result.proved,
        'reason': result.reason,
        'penalty': result.penalty,
        'goal_penalties': list(result.goal_penalties),
        'd': result.table.d.tolist(),
        'a': result.table.a.tolist(),
        'alpha': result.table.alpha.tolist(),
        'iterations': result.iterations,
        'evaluations': result.evaluations,
        'elapsed_s': result.elapsed,
        'verdicts': []
        if result.proof is None
        else [verdict.to_json() for verdict in result.proof.verdicts],
    }


def describe(result: DesignResult) -> str:
    """Return the result as a person reads it."""
    table = result.table
    head = 'PROVED' if result.proved else 'NOT PROVED'
    lines = [
        f'{head}: {result.reason}',
        f'{result.iterations} tables, {result.evaluations} penalty evaluations, '
        f'{result.elapsed:.2f} s; penalty {result.penalty:.3g}',
        'joint        d (m)      a (m)  alpha (deg)',
    ]
    alpha = np.rad2deg(table.alpha)
    lines += [
        f'{table.joints[i].name:<8} {table.d[i]:9.4f}  {table.a[i]:9.4f}  {alpha[i]:11.3f}'
        for i in range(table.n)
    ]
    if result.proof is not None:
        lines += [
            f'goal {v.point}: {v.verdict.value}, ball of {v.margin:.3g} m'
            for v in result.proof.verdicts
        ]
    return '\n'.join(lines)


def _value(option: str, name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise InputError(f'--{option} {name}', f'{text!r} is not a number') from None
    return float(np.deg2rad(value)) if name.startswith('alpha') else value


@contextmanager
def _ctrl_c() -> Iterator[threading.Event]:
    """Give an event that the first Ctrl-C sets; the second one interrupts as usual."""
    stop = threading.Event()

    def first(*_: Any) -> None:
        stop.set()
        signal.signal(signal.SIGINT, before)
        print('stopping; the best design is kept (Ctrl-C again to leave at once)', file=sys.stderr)

    before = signal.signal(signal.SIGINT, first)
    try:
        yield stop
    finally:
        signal.signal(signal.SIGINT, before)


class _Progress:
    """A live line on standard error: tables tried, penalties, temperature, time left."""

    def __init__(self, settings: DesignSettings) -> None:
        self._bar = tqdm(
            desc=f'{settings.method} seed {settings.seed}',
            unit=' tables',
            disable=None,
            mininterval=0.2,
            bar_format='{desc}: {n_fmt} tables, {elapsed}, {rate_fmt}{postfix}',
        )

    def __enter__(self) -> _Progress:
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()

    def show(self, candidate: Candidate, best: Candidate) -> None:
        """Show the latest accepted candidate."""
        self._bar.update(max(candidate.iteration - self._bar.n, 0))
        self._bar.set_postfix_str(
            f'penalty {candidate.penalty:.3g}, best {best.penalty:.3g}, '
            f'T {candidate.temperature:.3g}, accepted {candidate.acceptance_rate:.0%}',
            refresh=False,
        )
