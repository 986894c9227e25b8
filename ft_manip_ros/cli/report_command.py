"""`ftmanip report`: one page of what happened in a bag."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.bags.report_data import collect
from ft_manip_ros.bags.report_page import page
from ft_manip_ros.bags.report_plots import draw
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.whole_file import write_whole


def add_parser(subparsers: Any) -> None:
    """Declare the command's arguments."""
    parser = subparsers.add_parser(
        'report',
        help='write a report of a bag',
        description='Write what happened in a bag as one self-contained HTML page, with its '
        'pictures as PNG files beside it.',
    )
    parser.add_argument('bag', type=Path, help='rosbag2 folder, .mcap or .db3 file')
    parser.add_argument('--output', type=Path, required=True, help='folder to write into')
    parser.add_argument('--arm', default='', help='arm, if the bag does not say which')


def run(args: argparse.Namespace) -> int:
    """Write the report and say where it is."""
    data = collect(open_bag(args.bag), args.arm)
    try:
        args.output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(str(args.output), f'cannot be written: {error.strerror}') from None
    path = args.output / 'report.html'
    write_whole(path, page(data, draw(data, args.output)))
    print(path)
    return 0
