"""`ftmanip detect`: the fault monitor over recorded joint data."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.detection.feed import MonitorFeed
from ft_manip_ros.core.detection.monitor import FaultMonitor
from ft_manip_ros.core.detection.offline import Trace, detect, watched_joints
from ft_manip_ros.core.detection.recording_csv import read_csv
from ft_manip_ros.core.detection.settings import MonitorSettings
from ft_manip_ros.core.detection.states import Edge, JointState
from ft_manip_ros.core.errors import InputError

_BAG_SUFFIXES = ('.mcap', '.db3')


def add_parser(subparsers: Any) -> None:
    """Add the sub-command."""
    parser = subparsers.add_parser(
        'detect',
        help='run the fault monitor over recorded joint data',
        description='Run the same state machine as the node fault_monitor over a bag or a CSV '
        '(columns: time in s, position.NAME and, where known, velocity.NAME, effort.NAME, '
        'command.NAME, tool.x, tool.y, tool.z; empty cells mean "not in this sample"), and print '
        'each change of state.',
    )
    parser.add_argument('source', nargs='?', help='CSV file, rosbag2 folder, .mcap or .db3')
    parser.add_argument('--arm', help='arm file, its name in config/arms, or a URDF')
    parser.add_argument('--base', help='base link, for a URDF')
    parser.add_argument('--tip', help='tip link, for a URDF')
    parser.add_argument('--exempt', nargs='+', default=[], metavar='JOINT', help='never LOCKED')
    parser.add_argument('--sensitivity', type=float, default=1.0, help='2: twice the evidence')
    parser.add_argument('--reference', metavar='TOPIC', help='JointState topic with commands')
    parser.add_argument(
        '--tool', metavar='TOPIC', help='PoseStamped topic with poses of the tool; needs --arm'
    )
    parser.add_argument('--json', action='store_true', help='one JSON object a line and edge')
    parser.add_argument('--plot', metavar='OUT.png', help='draw signal, command and evidence')
    parser.add_argument(
        '--evaluate',
        metavar='DIR',
        help='implant faults into the healthy recordings of a folder, report how they are found',
    )
    parser.add_argument('--trials', type=int, default=40, help='per recording and kind of fault')
    parser.add_argument('--seed', type=int, default=0, help='of the evaluation')


def run(args: argparse.Namespace) -> int:
    """Detect or evaluate, and print."""
    if (args.source is None) == (args.evaluate is None):
        raise InputError('detect', 'needs either a bag or CSV to look at, or --evaluate DIR')
    settings = MonitorSettings(sensitivity=args.sensitivity)
    if args.evaluate is not None:
        return _evaluate(args, settings)
    chain = load_arm(args.arm, base=args.base, tip=args.tip) if args.arm else None
    path = Path(args.source)
    if not path.exists():
        raise InputError(str(path), 'does not exist; give a CSV file, a bag folder or a bag file')
    is_bag = path.is_dir() or path.suffix in _BAG_SUFFIXES
    monitor, edges, trace = (_detect_bag if is_bag else _detect_csv)(path, args, chain, settings)
    for edge in edges:
        print(json.dumps(_edge_object(edge)) if args.json else _edge_line(edge), flush=True)
    if not args.json:
        _summarise(monitor)
    if trace is not None:
        from ft_manip_ros.cli.detect_plot import draw

        draw(Path(args.plot), path.name, trace, edges)
    return 0


def _detect_csv(
    path: Path, args: argparse.Namespace, chain: SerialChain | None, settings: MonitorSettings
) -> tuple[FaultMonitor, list[Edge], Trace | None]:
    recording = read_csv(path)
    names, _ = _watched(recording.joints, chain)
    trace = Trace.empty(names) if args.plot else None
    monitor, edges = detect(
        recording, chain=chain, settings=settings, exempt=args.exempt, trace=trace
    )
    return monitor, edges, trace


def _detect_bag(
    path: Path, args: argparse.Namespace, chain: SerialChain | None, settings: MonitorSettings
) -> tuple[FaultMonitor, list[Edge], Trace | None]:
    from ft_manip_ros.bags.joint_data import feed_bag, joint_names, joint_state_topics
    from ft_manip_ros.bags.reader import open_bag

    bag = open_bag(path)
    topics = joint_state_topics(bag)
    found = joint_names(bag, topics)
    names, joints = _watched(found, chain)
    if args.tool and chain is None:
        raise InputError('--tool', 'needs the arm (--arm) whose tool it is')
    monitor = FaultMonitor(
        joints,
        settings,
        exempt=[n for n in args.exempt if n in names],
        chain=chain if args.tool else None,
    )
    trace = Trace.empty(names) if args.plot else None
    edges, problems = feed_bag(
        bag,
        MonitorFeed(monitor, None),
        topics,
        reference=args.reference,
        tool=args.tool,
        on_sample=None if trace is None else lambda stamp: trace.note(monitor, stamp),
    )
    for problem in [*bag.notes, *problems]:
        print(problem, file=sys.stderr)
    return monitor, edges, trace


def _watched(found: tuple[str, ...], chain: SerialChain | None) -> tuple[tuple[str, ...], Any]:
    joints, foreign = watched_joints(found, chain)
    if foreign:
        print(f'not joints of the arm, ignored: {", ".join(sorted(foreign))}', file=sys.stderr)
    return tuple(j if isinstance(j, str) else j.name for j in joints), joints


def _edge_object(edge: Edge) -> dict[str, Any]:
    """Return the line of ``--json``: angles in rad (or m), times in s, null for unknown."""
    report = edge.report
    locked = report.state == JointState.LOCKED
    return {
        'time': edge.stamp * 1e-9,
        'joint': report.name,
        'state': report.state.name,
        'angle': _number(report.frozen_position if locked else report.position),
        'sigma': _number(report.frozen_position_sigma) if locked else None,
        'first_evidence': report.first_evidence * 1e-9 if report.first_evidence else None,
        'cause': report.cause,
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _edge_line(edge: Edge) -> str:
    report = edge.report
    where = f'{report.position:.6g}'
    if report.state == JointState.LOCKED:
        where = f'{report.frozen_position:.6g} ± {report.frozen_position_sigma:.2g}'
    return (
        f'{edge.stamp * 1e-9:14.6f}  {report.name:<16} {edge.previous.name} -> '
        f'{report.state.name} at {where}: {report.cause}'
    )


def _summarise(monitor: FaultMonitor) -> None:
    print('\njoint            state     position    noise      suspected')
    for report in monitor.states():
        print(
            f'{report.name:<16} {report.state.name:<9} {report.position:<11.6g} '
            f'{report.noise:<10.2g} {report.suspects}'
        )


def _evaluate(args: argparse.Namespace, settings: MonitorSettings) -> int:
    from ft_manip_ros.core.detection.evaluate import evaluate
    from ft_manip_ros.core.detection.telemetry import load_folder

    if args.trials < 1:
        raise InputError('--trials', f'is {args.trials}; at least 1 is needed')
    result = evaluate(
        load_folder(Path(args.evaluate)), trials=args.trials, seed=args.seed, settings=settings
    )
    print(json.dumps(result.to_json()) if args.json else result.table())
    return 0 if result.passed else 1
