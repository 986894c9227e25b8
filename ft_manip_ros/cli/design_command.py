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

from ft_manip_ros.cli.design_output import Progress, describe, to_json
from ft_manip_ros.core.arm_file import save_dh
from ft_manip_ros.core.design.candidate import DesignResult
from ft_manip_ros.core.design.certificate import write_certificate
from ft_manip_ros.core.design.problem import design_problem
from ft_manip_ros.core.design.search import design_arm
from ft_manip_ros.core.design.settings import EXECUTORS, METHODS, DesignSettings
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
    parser.add_argument(
        '--max-segments', type=int, default=0, help='units of work to give up after (0: no end)'
    )
    parser.add_argument('--workers', type=int, default=1, help='searches side by side')
    parser.add_argument(
        '--executor', choices=EXECUTORS, default=defaults.executor, help='what the workers are'
    )
    parser.add_argument('--scheduler', default='', help='address of a Dask scheduler')
    parser.add_argument(
        '--margin', type=float, default=defaults.margin,
        help="room around every goal, as a share of the farthest goal's distance",
    )  # fmt: skip
    parser.add_argument(
        '--ball',
        type=float,
        default=0.0,
        help='reach the whole ball of this radius (m) around goals that have no region',
    )
    parser.add_argument(
        '--alpha-step-deg', type=float, default=0.0, help='alpha is a multiple of this'
    )
    parser.add_argument('--family', choices=FAMILIES, default='')
    parser.add_argument('--max-length', type=float, help='longest sum of link lengths (m)')
    parser.add_argument(
        '--shorten', action='store_true', help='then make the proved design shorter'
    )
    parser.add_argument(
        '--bound', nargs=3, action='append', default=[], metavar=('PARAMETER', 'LOWER', 'UPPER'),
        help='range of d, a or alpha, or of one parameter (a_3); m and deg',
    )  # fmt: skip
    parser.add_argument(
        '--fix', nargs=2, action='append', default=[], metavar=('PARAMETER', 'VALUE'),
        help='value of one parameter, e.g. alpha_2 90; m and deg',
    )  # fmt: skip
    parser.add_argument('--output', help='arm file to write the design to')
    parser.add_argument('--certificate', help='JSON file for the proofs, which are verified too')
    parser.add_argument('--report', help='PNG file: hardest RODs, FTWS slice, penalties')
    parser.add_argument(
        '--checkpoint', help='file to keep the search in (default: OUTPUT.checkpoint)'
    )
    parser.add_argument(
        '--resume', action='store_true', help='go on from the checkpoint of a broken search'
    )
    parser.add_argument('--force', action='store_true', help='overwrite files')
    parser.add_argument('--json', action='store_true', help='print the result as JSON')


def run(args: argparse.Namespace) -> int:
    """Search, print, write; exit code 1 where nothing was proved."""
    task = load_task(args.task)
    spec = specification(args, task)
    settings = DesignSettings(
        method=args.method,
        seed=args.seed,
        time_budget=args.time_budget,
        max_segments=args.max_segments,
        workers=args.workers,
        executor=args.executor,
        scheduler=args.scheduler,
        margin=args.margin,
        ball=args.ball,
        alpha_step=float(np.deg2rad(args.alpha_step_deg)),
        family=args.family,
        shorten=args.shorten,
        max_length=np.inf if args.max_length is None else args.max_length,
        bounds={
            name: (_value('bound', name, lower), _value('bound', name, upper))
            for name, lower, upper in args.bound
        },
        fixed={name: _value('fix', name, value) for name, value in args.fix},
    )
    checkpoint = args.checkpoint or (f'{args.output}.checkpoint' if args.output else None)
    if args.resume and checkpoint is None:
        raise InputError('--resume', 'needs --checkpoint, or the --output of the broken search')
    for option in ('output', 'certificate', 'report'):
        _check_target(f'--{option}', getattr(args, option), args.force)
    with _ctrl_c() as stop, Progress(settings) as progress:
        result = design_arm(
            task,
            spec,
            settings,
            on_candidate=progress.show,
            should_stop=stop.is_set,
            checkpoint=checkpoint,
            resume=args.resume,
        )
    if args.output:
        save_dh(result.table, args.output)
    problem = design_problem(task, spec, settings)
    confirmed = _certify(args, problem.task, spec, result) if args.certificate else True
    if args.report:
        from ft_manip_ros.core.design.report import write_report

        write_report(args.report, problem, result, progress.penalties)
    print(json.dumps(to_json(task, spec, settings, result)) if args.json else describe(result))
    return 0 if result.proved and confirmed else 1


def _check_target(option: str, path: str | None, force: bool) -> None:
    if not path:
        return
    if os.path.exists(path) and not force:
        raise InputError(option, f'{path} exists; --force overwrites it')
    folder = os.path.dirname(path) or '.'
    if not os.path.isdir(folder):
        raise InputError(option, f'the folder {folder} does not exist')


def _certify(args: argparse.Namespace, task: Task, spec: DesignSpec, result: DesignResult) -> bool:
    """Write the proofs of a proved design; False where the verifier does not confirm them."""
    if not result.proved:
        print('no certificate: the design is not proved', file=sys.stderr)
        return True
    outcomes = write_certificate(args.certificate, result.table.chain(), task, spec.order)
    for confirmed, text in outcomes:
        if not confirmed:
            print(f'the verifier does not confirm a proof: {text}', file=sys.stderr)
    return all(confirmed for confirmed, _ in outcomes)


def specification(args: argparse.Namespace, task: Task) -> DesignSpec:
    """Return what to design: the options where given, else the task's design section."""
    if task.design is None and args.dof is None:
        raise InputError('--dof', f'is needed: task {task.name!r} has no design section')
    spec = task.design or DesignSpec(args.dof)
    changes: dict[str, Any] = {}
    if args.limits_deg is not None:
        changes['lower'], changes['upper'] = np.deg2rad(args.limits_deg).tolist()
    if args.dof is not None:
        changes['dof'] = args.dof
    if args.order is not None:
        changes['order'] = args.order
    return replace(spec, **changes)


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
