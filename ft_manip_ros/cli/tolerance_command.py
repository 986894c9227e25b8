"""`ftmanip tolerance`: which joint may lock at which instant of a task, and a path to survive."""

from __future__ import annotations

import argparse
import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import Task
from ft_manip_ros.core.planning.plan import Plan
from ft_manip_ros.core.planning.replan import plan_task
from ft_manip_ros.core.planning.settings import PlanSettings
from ft_manip_ros.core.planning.tolerance import Fate, ToleranceMap, tolerance_map
from ft_manip_ros.core.planning.tolerant_path import TolerantPath, most_tolerant_path
from ft_manip_ros.core.task_file import load_task
from ft_manip_ros.core.whole_file import whole_file


def add_parser(subparsers: Any) -> None:
    """Add the sub-command."""
    parser = subparsers.add_parser(
        'tolerance',
        help='which failures, and when, a task survives',
        description='Judge the planned path of a task instant by instant and joint by joint: '
        'would a lock there and then leave the rest of the task feasible? Then find the path '
        'that survives the most.',
    )
    parser.add_argument('arm', help='arm file, its name in config/arms, or a URDF')
    parser.add_argument('task', help='task file, or its name in config/tasks')
    parser.add_argument('--base', help='base link, for a URDF')
    parser.add_argument('--tip', help='tip link, for a URDF')
    parser.add_argument(
        '--start', nargs='+', type=float, metavar='Q',
        help='where the joints stand, base to tip (rad or m); by default 0, or the middle of the '
        'limits where they exclude 0',
    )  # fmt: skip
    parser.add_argument('--samples', type=int, default=100, help='instants to judge')
    parser.add_argument('--seed', type=int, default=0, help='of the posture searches')
    parser.add_argument(
        '--boxes', type=int, default=20_000, help='branch-and-bound boxes a proof may take'
    )
    parser.add_argument('--plot', metavar='PNG', help='draw instants by joints')
    parser.add_argument('--output', metavar='CSV', help='write the most tolerant path')
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def run(args: argparse.Namespace) -> int:
    """Judge both paths and print."""
    if args.samples < 2:
        raise InputError('--samples', f'is {args.samples}; at least 2 instants are needed')
    arm = load_arm(args.arm, base=args.base, tip=args.tip)
    task = load_task(args.task)
    settings = PlanSettings(seed=args.seed, proof_boxes=args.boxes)
    start = _start(arm, args.start)
    paths = {'planned': _planned(arm, task, start, settings)}
    tolerant = most_tolerant_path(arm, task.goals, start, settings)
    if tolerant is None:
        raise InputError(f'task {task.name!r}', 'has a goal no posture is known for')
    paths['most tolerant'] = tolerant
    maps = {
        name: tolerance_map(
            arm,
            task.goals,
            path.trajectory,
            path.arrivals,
            samples=args.samples,
            settings=settings,
        )
        for name, path in paths.items()
    }
    if args.json:
        print(json.dumps({name: to_json(maps[name], path) for name, path in paths.items()}))
    else:
        print(describe(maps, paths, task, tolerant.survivable))
    if args.output:
        _write(Path(args.output), paths['most tolerant'])
    if args.plot:
        from ft_manip_ros.cli.tolerance_plot import draw

        draw(maps, {name: path.arrivals for name, path in paths.items()}, task, args.plot)
    return 0


def _start(arm: SerialChain, given: list[float] | None) -> Array:
    if given is not None:
        return arm.check_vector(given, '--start')
    lower, upper = arm.operating_lower, arm.operating_upper
    return np.where((lower <= 0.0) & (upper >= 0.0), 0.0, 0.5 * (lower + upper))


def _planned(arm: SerialChain, task: Task, start: Array, settings: PlanSettings) -> TolerantPath:
    plan: Plan = plan_task(
        arm,
        list(enumerate(task.goals)),
        frozen={},
        sigma={},
        start=start,
        start_velocity=np.zeros(arm.n),
        settings=settings,
    )
    arrivals = {o.index: o.arrival for o in plan.outcomes if o.has_posture}
    if plan.trajectory is None or len(arrivals) < len(task.goals):
        raise InputError(f'task {task.name!r}', f'cannot be done by {arm.name!r}: {plan.reason}')
    return TolerantPath(plan.trajectory, arrivals)


def describe(
    maps: dict[str, ToleranceMap],
    paths: dict[str, TolerantPath],
    task: Task,
    survivable: NDArray[np.bool_] | None,
) -> str:
    """Return the shares of each joint as a table, and when and why it may not lock."""
    lines = []
    for kind, judged in maps.items():
        lines.append(
            f'{kind} path, {paths[kind].trajectory.duration:.2f} s: any one joint may lock for '
            f'{100.0 * judged.any_joint:.0f} % of the time, all but {judged.exposed:.2f} s'
        )
        lines.append(f'  {"joint":24} {"survived":>9} {"lost":>7} {"open":>7}')
        for k, joint in enumerate(judged.joint_names):
            survived, lost = judged.survived[k], judged.proved_lost[k]
            lines.append(
                f'  {joint:24} {100 * survived:8.1f}% {100 * lost:6.1f}% '
                f'{100 * max(0.0, 1 - survived - lost):6.1f}%'
            )
        for place, begin, end, fate, goal in judged.stretches():
            name = task.goals[goal].id or f'goal {goal}'
            why = 'is lost (proved)' if fate == Fate.LOST else 'is open'
            # The goals that remain are those from the first one not yet reached.
            arrivals = paths[kind].arrivals
            first = min((k for k in arrivals if arrivals[k] > begin), default=len(arrivals))
            if survivable is not None and not survivable[first, place]:
                why += '; wherever it locks while these goals remain'
            lines.append(
                f'    {judged.joint_names[place]} {begin:.2f} to {end:.2f} s: {name} {why}'
            )
    lines.append('survived: a posture is known for every goal that remains; lost: proved.')
    return '\n'.join(lines)


def to_json(judged: ToleranceMap, path: TolerantPath) -> dict[str, Any]:
    """Return a map as plain numbers; fates are 0 lost, 1 open, 2 survived."""
    return {
        'joints': list(judged.joint_names),
        'duration': path.trajectory.duration,
        'arrivals': [path.arrivals[k] for k in sorted(path.arrivals)],
        'any_joint': judged.any_joint,
        'exposed': judged.exposed,
        'survived': judged.survived.tolist(),
        'lost': judged.proved_lost.tolist(),
        'times': judged.times.tolist(),
        'fates': judged.fates.tolist(),
        'culprits': judged.culprits.tolist(),
    }


def _write(file: Path, path: TolerantPath) -> None:
    """Write time and joint positions, one point a row."""
    with whole_file(file) as partial, partial.open('w', newline='') as stream:
        writer = csv.writer(stream)
        writer.writerow(['time', *path.trajectory.joint_names])
        for time, q in zip(path.trajectory.times, path.trajectory.positions, strict=True):
            writer.writerow([f'{time:.9f}', *(f'{x:.12g}' for x in q)])
