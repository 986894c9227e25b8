"""What the demo can be asked for."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.errors import InputError

# Robots known by one word: URDF (of the PyPI package example-robot-data), base, tool.
KNOWN_ROBOTS = {
    'panda': (
        'package://example-robot-data/robots/panda_description/urdf/panda.urdf',
        'panda_link0',
        'panda_hand_tcp',
    ),
}


def parse_options(arguments: Sequence[str]) -> argparse.Namespace:
    """Read the command line; ends the process with exit code 2 where it is wrong."""
    parser = argparse.ArgumentParser(
        prog='demo',
        description='A joint locks in the middle of a task, and the arm finishes the task: the '
        'whole story, as separate processes that talk over DDS on this machine only.',
        epilog='Exit code 0: all of it happened; 1: something did not; 2: bad usage.',
    )
    parser.add_argument(
        '--joint',
        default='',
        help='which joint locks: its name, its number from 1, or "all" for one run each '
        '(default: a random one)',
    )
    parser.add_argument('--seed', type=int, default=None, help='of every random choice')
    parser.add_argument(
        '--arm',
        default='',
        help='take this arm instead of designing one: a name from config/arms, an arm file, a '
        f'URDF, or {", ".join(KNOWN_ROBOTS)}',
    )
    parser.add_argument('--base', default='', help='base link, for a URDF')
    parser.add_argument('--tip', default='', help='tool link, for a URDF')
    parser.add_argument(
        '--task', default='', help='name from config/tasks, or a task file (default: the paper\'s)'
    )  # fmt: skip
    parser.add_argument(
        '--design-time', type=float, default=25.0, help='time budget of the designer (s)'
    )
    parser.add_argument(
        '--output', type=Path, default=None, help='folder for bags, pictures and logs'
    )
    parser.add_argument(
        '--headless', action='store_true', help='do not open the picture at the end'
    )
    parser.add_argument(
        '--domain', type=int, default=None, help='ROS_DOMAIN_ID (default: one that is free)'
    )
    options = parser.parse_args(arguments)
    if options.seed is None:
        options.seed = time.time_ns() % 100_000
    if options.seed < 0:
        parser.error('--seed must not be negative')
    if options.design_time <= 0.0:
        parser.error('--design-time must be more than 0 s')
    if options.domain is not None and not 0 <= options.domain <= 232:
        parser.error('--domain must be from 0 to 232')
    if options.arm in KNOWN_ROBOTS:
        arm, base, tip = KNOWN_ROBOTS[options.arm]
        options.task = options.task or f'{options.arm}_reach'
        options.arm, options.base, options.tip = arm, options.base or base, options.tip or tip
    options.task = options.task or 'paredis_eq_11'
    if options.output is None:
        options.output = Path('out') / time.strftime('demo_%Y%m%d_%H%M%S')
    return options


def arm_of(options: argparse.Namespace) -> SerialChain:
    """Load the arm that was asked for."""
    return load_arm(options.arm, base=options.base or None, tip=options.tip or None)


def chosen_joints(wanted: str, chain: SerialChain) -> list[str]:
    """Names of the joints to lock, one per run; empty: let the seed choose.

    Raises
    ------
    InputError
        For a joint that the arm does not have.
    """
    if not wanted:
        return []
    if wanted == 'all':
        return list(chain.joint_names)
    if wanted.isdigit():
        if not 1 <= int(wanted) <= chain.n:
            raise InputError('--joint', f'is {wanted}; {chain.name!r} has joints 1 to {chain.n}')
        return [chain.joint_names[int(wanted) - 1]]
    return [chain.joint_names[chain.index(wanted)]]
