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
from ft_manip_ros.core.urdf_writer import chain_to_urdf
from ft_manip_ros.core.whole_file import write_whole

_URDF = ('.urdf', '.xml')


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
    parser.add_argument(
        '--output',
        help='write the arm with these operating limits: an arm file, or a .urdf with soft limits',
    )
    parser.add_argument('--moveit', help="write MoveIt's joint_limits.yaml")
    parser.add_argument('--threads', type=int, default=os.cpu_count() or 1)


def run(args: argparse.Namespace) -> int:
    """Search, print and write."""
    chain = load_arm(args.arm, base=args.base, tip=args.tip)
    task = load_task(args.task)
    output = Path(args.output) if args.output else None
    from_urdf = Path(args.arm).suffix in _URDF
    if output and from_urdf and output.suffix not in _URDF:
        raise InputError(
            f'--output {output}', 'is no .urdf; the arm is one and has no table for an arm file'
        )
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
    if output:
        _write_arm(found.chain, args.arm, output)
    if args.moveit:
        limits = moveit_joint_limits(found.chain)
        write_whole(args.moveit, yaml.safe_dump(limits, sort_keys=False))
    return 0 if found.proved else 1


def _write_arm(chain: SerialChain, arm: str, output: Path) -> None:
    """Write the arm with its new operating limits, as URDF or as a DH table."""
    if output.suffix in _URDF:
        write_whole(output, chain_to_urdf(chain))
    else:
        save_dh(replace(load_dh(arm), joints=chain.joints), output)
