"""`ftmanip template`: the paper's template arms, scaled until they cover a task."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from ft_manip_ros.core.arm_file import save_dh
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.templates import TEMPLATES, cover
from ft_manip_ros.core.ftws.verdict import Verdict
from ft_manip_ros.core.goal import Task
from ft_manip_ros.core.task_file import load_task


def add_parser(subparsers: Any) -> None:
    """Add the sub-command."""
    parser = subparsers.add_parser(
        'template',
        help="scale one of the paper's template arms to a task",
        description='The smallest fault-tolerant arm without joint limits, of the shape of Table '
        '1 (positions) or Table 2 (poses), that covers the goals of a task: in closed form, and '
        'proved. Exit code 1: some goal was not proved a member.',
    )
    parser.add_argument('task', help='task file, or its name in config/tasks')
    parser.add_argument(
        '--template', choices=TEMPLATES, help='default: by whether goals have an orientation'
    )
    parser.add_argument(
        '--clearance', type=float, default=0.0, help='also covers this much around each goal (m)'
    )
    parser.add_argument('--output', type=Path, metavar='ARM.yaml', help='write the arm')
    parser.add_argument('--threads', type=int, default=os.cpu_count() or 1)
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def run(args: argparse.Namespace) -> int:
    """Scale, prove, print and write."""
    task = load_task(args.task)
    points = _positions(task)
    oriented = any(goal.orientation is not None for goal in task.goals)
    template = args.template or TEMPLATES[int(oriented)]
    if oriented and template == TEMPLATES[0]:
        raise InputError(
            '--template', f'is {template}, which has no wrist; the goals have orientations'
        )
    table = cover(points, template, args.clearance)
    # The first link of both templates is 1 m long.
    scale = float(table.a[0])
    results = query(
        table.chain(), task.goals, mode='pose' if oriented else 'position', threads=args.threads
    )
    proved = all(result.verdict is Verdict.MEMBER for result in results)
    if args.output:
        save_dh(table, args.output)
    if args.json:
        verdicts = [result.verdict.value for result in results]
        print(json.dumps({'template': template, 'scale': scale, 'verdicts': verdicts}))
    else:
        print(f'{template} at scale {scale:.6g}: reach {2.0 * scale:.6g} m about the first axis')
        for goal, result in zip(task.goals, results, strict=True):
            print(f'{goal.id:<12} {result.verdict.value.upper()}: {result.reason}')
    return 0 if proved else 1


def _positions(task: Task) -> np.ndarray:
    """Positions (N, 3) of goals that are single points."""
    for goal in task.goals:
        if goal.region is not None:
            raise InputError(
                f'task {task.name!r}: {goal.id}',
                'is a volume; templates cover points and poses (ftmanip design covers volumes)',
            )
    return np.array([goal.position for goal in task.goals])
