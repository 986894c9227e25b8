"""`ftmanip limits`: operating limits that keep a task fault tolerant."""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from ft_manip_ros.core.arm_file import load_arm, load_dh, save_dh
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.operating_limits import find_operating_limits, moveit_joint_limits
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.task_file import load_task


def add_parser(subparsers: Any) -> None:
    """Add the sub-command."""
    parser = subparsers.add_parser(
        'limits',
        help='find operating limits that keep points fault tolerant',
        description='Find the widest operating limits under which every goal of a task stays '
        'reachable whichever joint locks within them. Exit code 1: there are none.',
    )
    parser.add_argument('arm', help='arm file, its name in config/arms, or a URDF')
    parser.add_argument('task', help='task file, or its name in config/tasks')
    parser.add_argument('--base', help='base link, for a URDF')
    parser.add_argument('--tip', help='tip link, for a URDF')
    parser.add_argument('--mode', choices=('position', 'pose'), default='position')
    parser.add_argument('--tolerance', type=float, default=1e-6, help='reach tolerance (m)')
    parser.add_argument('--output', help='write the arm with these limits (for a DH arm file)')
    parser.add_argument('--moveit', help="write MoveIt's joint_limits.yaml")
    parser.add_argument('--threads', type=int, default=os.cpu_count() or 1)


def run(args: argparse.Namespace) -> int:
    """Search, print and write."""
    chain = load_arm(args.arm, base=args.base, tip=args.tip)
    task = load_task(args.task)
    is_table = not str(args.arm).endswith(('.urdf', '.xml')) and '<' not in str(args.arm)
    if args.output and not is_table:
        raise InputError('--output', 'needs a DH arm file; for a URDF use --moveit')
    found = find_operating_limits(
        chain,
        task.goals,
        mode=args.mode,
        settings=FtwsSettings(tolerance=args.tolerance),
        threads=args.threads,
    )
    for name, interval in found.limits.items():
        text = 'nowhere' if interval is None else f'[{interval[0]:.4f}, {interval[1]:.4f}]'
        print(f'{name:<20} {text}')
    print(found.reason)
    if found.chain is None:
        return 1
    if args.output:
        save_dh(_with_limits(args.arm, found.chain), args.output)
    if args.moveit:
        _write_yaml(moveit_joint_limits(found.chain), args.moveit)
    return 0 if found.proved else 1


def _with_limits(arm: str, chain: SerialChain) -> Any:
    table = load_dh(arm)
    return replace(table, joints=chain.joints)


def _write_yaml(content: dict[str, Any], path: str) -> None:
    target = Path(path)
    partial = target.with_name(f'.{target.name}.{os.getpid()}')
    try:
        partial.write_text(yaml.safe_dump(content, sort_keys=False), encoding='utf-8')
        partial.replace(target)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise InputError(path, f'cannot be written: {error.strerror}') from error
