"""`ftmanip replay`: re-run a bag through the same cores and compare with what it recorded."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import yaml

from ft_manip_ros.bags.expected import check_expected
from ft_manip_ros.bags.findings import Difference, Finding
from ft_manip_ros.bags.reader import Bag, open_bag
from ft_manip_ros.bags.replay import ReplayResult, replay
from ft_manip_ros.core.errors import InputError

_SECOND = 1_000_000_000


def add_parser(subparsers: Any) -> None:
    """Declare the command's arguments."""
    parser = subparsers.add_parser(
        'replay',
        help='re-run a bag and compare with what it recorded',
        description='Re-run the recorded inputs through the fault monitor, the FTWS engine and '
        'the re-planner, with the recorded parameters, and compare verdicts, faults and plans '
        'with the recorded ones.',
    )
    parser.add_argument('bag', type=Path, help='rosbag2 folder, .mcap or .db3 file')
    parser.add_argument(
        '--check', action='store_true', help='exit with 1 on any difference, and say which'
    )
    parser.add_argument(
        '--exact',
        action='store_true',
        help='compare margins, witnesses and trajectories, too: for a bag of this very version',
    )
    parser.add_argument(
        '--expected',
        type=Path,
        help='also compare with this expected.yaml (with --check: the one beside the bag)',
    )
    parser.add_argument(
        '--from', dest='start', type=float, metavar='T', help='start at T s from the beginning'
    )
    parser.add_argument('--to', dest='end', type=float, metavar='T', help='end at T s')
    parser.add_argument(
        '--override',
        action='append',
        default=[],
        metavar='PARAM=VALUE',
        help='parameter instead of the recorded one, as NAME=VALUE or NODE.NAME=VALUE; repeatable',
    )
    parser.add_argument('--arm', default='', help='arm file, name or URDF instead of the recorded')
    parser.add_argument('--threads', type=int, default=1, help='threads for FTWS queries')
    parser.add_argument('--json', action='store_true', help='print one JSON object')
    parser.add_argument(
        '--live',
        action='store_true',
        help='publish the messages on DDS with /clock instead, for nodes with use_sim_time',
    )
    parser.add_argument('--rate', type=float, default=1.0, help='speed of --live (default: 1)')


def run(args: argparse.Namespace) -> int:
    """Replay and print; 1 if a check failed."""
    bag = open_bag(args.bag)
    start, end = _window(bag, args.start, args.end)
    if args.live:
        from ft_manip_ros.nodes.bag_player import play

        return play(bag, rate=args.rate, start=start, end=end)
    result = replay(
        bag,
        overrides=dict(_override(text) for text in args.override),
        arm=args.arm,
        start=start,
        end=end,
        threads=args.threads,
        exact=args.exact,
    )
    expected = args.expected
    if expected is None and args.check and not args.override:
        beside = bag.path.parent / 'expected.yaml'
        expected = beside if beside.is_file() else None
    problems = check_expected(expected, result) if expected else []
    if args.json:
        print(json.dumps(_as_json(result, problems)))
    else:
        _print(bag, result, problems)
    failed = bool(result.differences or problems)
    if failed and args.check:
        print('replay: NOT reproduced', file=sys.stderr)
        return 1
    return 0


def _window(bag: Bag, start: float | None, end: float | None) -> tuple[int | None, int | None]:
    for name, value in (('--from', start), ('--to', end)):
        if value is not None and not value >= 0.0:
            raise InputError(name, f'is {value}; must be a time >= 0 s from the beginning')
    if start is not None and end is not None and start >= end:
        raise InputError('--from', f'is {start}; must be before --to ({end})')
    return (
        None if start is None else bag.start + round(start * _SECOND),
        None if end is None else bag.start + round(end * _SECOND),
    )


def _override(text: str) -> tuple[str, Any]:
    name, equals, value = text.partition('=')
    if not equals or not name:
        raise InputError(f'--override {text}', 'is not of the form PARAM=VALUE')
    try:
        return name, yaml.safe_load(value)
    except yaml.YAMLError:
        raise InputError(f'--override {text}', f'the value {value!r} is not readable') from None


def _print(bag: Bag, result: ReplayResult, problems: list[str]) -> None:
    for note in result.notes:
        print(f'note: {note}')
    for reason, count in result.refused.items():
        print(f'refused {count} times: {reason}')
    for finding in result.replayed:
        print(f'{_time(bag, finding.stamp)}  {finding.kind:<8} {finding.text()}')
    if result.differences:
        print('\nDifferences (time, recorded, replayed):')
        for difference in result.differences:
            _print_difference(bag, difference)
    for problem in problems:
        print(f'not as expected: {problem}')
    kinds = dict.fromkeys(('verdicts', 'faults', 'plans'), 0)
    for finding in result.replayed:
        kinds[f'{finding.kind}s'] += 1
    print(
        f'\n{result.messages} messages of {result.duration:.1f} s in {result.elapsed:.2f} s: '
        + ', '.join(f'{count} {kind}' for kind, count in kinds.items())
        + f'; {len(result.differences)} differences'
    )
    print(f'digest {result.digest}')


def _print_difference(bag: Bag, difference: Difference) -> None:
    old, new = difference.recorded, difference.replayed
    shift = f' ({(new.stamp - old.stamp) * 1e-6:+.1f} ms)' if old and new else ''
    print(f'{_time(bag, difference.stamp)}  {", ".join(difference.fields) or "whole"}{shift}')
    for label, finding in (('recorded', old), ('replayed', new)):
        print(f'    {label}: {finding.kind + " " + finding.text() if finding else "nothing"}')


def _time(bag: Bag, stamp: int) -> str:
    return f'{(stamp - bag.start) * 1e-9:9.3f} s'


def _as_json(result: ReplayResult, problems: list[str]) -> dict[str, Any]:
    def shown(finding: Finding | None) -> Any:
        if finding is None:
            return None
        return {
            'kind': finding.kind,
            'stamp': finding.stamp,
            'about': finding.about,
            **finding.values,
            **finding.details,
        }

    return {
        'digest': result.digest,
        'messages': result.messages,
        'duration_s': result.duration,
        'elapsed_s': result.elapsed,
        'replayed': [shown(finding) for finding in result.replayed],
        'differences': [
            {'recorded': shown(d.recorded), 'replayed': shown(d.replayed), 'fields': d.fields}
            for d in result.differences
        ],
        'not_as_expected': problems,
        'refused': dict(result.refused),
        'notes': list(result.notes),
    }
