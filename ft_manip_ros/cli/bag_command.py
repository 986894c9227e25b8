"""`ftmanip bag`: look into a bag, repair it, convert it."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from ft_manip_ros.bags.copy import copy_bag
from ft_manip_ros.bags.info import lines, summary
from ft_manip_ros.bags.mcap_file import COMPRESSIONS
from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.bags.writer_settings import WriterSettings
from ft_manip_ros.core.errors import InputError

_MIB = 1 << 20


def add_parser(subparsers: Any) -> None:
    """Declare the command's arguments."""
    parser = subparsers.add_parser(
        'bag', help='look into a bag, repair it, convert it', description=__doc__
    )
    actions = parser.add_subparsers(dest='action', required=True)
    info = actions.add_parser('info', help='what is in it, and what is missing for a replay')
    info.add_argument('bag', type=Path, help='rosbag2 folder, .mcap or .db3 file')
    info.add_argument('--json', action='store_true', help='print one JSON object')
    recover = actions.add_parser(
        'recover',
        help='write everything readable of an unfinished or damaged bag into a whole one',
    )
    recover.add_argument('bag', type=Path, help='rosbag2 folder or .mcap file')
    recover.add_argument(
        'output', type=Path, nargs='?', help='folder to create (default: BAG_recovered)'
    )
    convert = actions.add_parser(
        'convert', help='write any bag (also .db3) as a rosbag2 folder with MCAP'
    )
    convert.add_argument('bag', type=Path, help='rosbag2 folder, .mcap or .db3 file')
    convert.add_argument('output', type=Path, help='folder to create')
    convert.add_argument('--compression', choices=list(COMPRESSIONS), default='zstd')
    convert.add_argument('--split-size', type=int, default=0, metavar='MIB')
    convert.add_argument('--split-duration', type=float, default=0.0, metavar='S')


def run(args: argparse.Namespace) -> int:
    """Do it; 1 if a bag to be recovered holds nothing readable."""
    bag = open_bag(args.bag)
    if args.action == 'info':
        content = summary(bag)
        print(json.dumps(content) if args.json else '\n'.join(lines(content)))
        return 0
    settings, output = WriterSettings(), args.output
    if args.action == 'convert':
        settings = WriterSettings(
            compression=args.compression,
            split_size=args.split_size * _MIB,
            split_duration=args.split_duration,
        )
    elif output is None:
        output = args.bag.with_name(f'{args.bag.stem}_recovered')
    try:
        count = copy_bag(bag, output, settings)
    except OSError as error:
        raise InputError(str(output), f'cannot be written: {error.strerror}') from None
    for note in bag.notes:
        print(f'note: {note}')
    print(f'{output}: {count} messages, {(bag.end - bag.start) * 1e-9:.3f} s')
    if count == 0:
        print(f'ftmanip bag: nothing of {args.bag} is readable', file=sys.stderr)
        return 1
    return 0
