"""`ftmanip ftws`: judge points or poses against the fault-tolerant work space of an arm."""

from __future__ import annotations

import argparse
import json
import os
from functools import partial
from typing import Any

import numpy as np
from tqdm import tqdm

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.certificate import certify, save_certificate
from ft_manip_ros.core.ftws.ftws_map import FtwsMap, load_map
from ft_manip_ros.core.ftws.map_build import build_map
from ft_manip_ros.core.ftws.map_frame import GRIDS, map_frame
from ft_manip_ros.core.ftws.map_query import query_with_map
from ft_manip_ros.core.ftws.point_file import read_points
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.task_map import MODES
from ft_manip_ros.core.ftws.verdict import FtwsResult

# Answers are printed as they come, a batch at a time.
_BATCH = 64


def add_parser(subparsers: Any) -> None:
    """Add the sub-command."""
    parser = subparsers.add_parser(
        'ftws',
        help='judge points: are they in the fault-tolerant work space?',
        description='Prove for each point or pose that it stays reachable whichever joints lock, '
        'or which lock loses it.',
    )
    parser.add_argument('arm', help='arm file, its name in config/arms, or a URDF')
    parser.add_argument('--base', help='base link, for a URDF')
    parser.add_argument('--tip', help='tip link, for a URDF')
    parser.add_argument(
        '--point', nargs='+', type=float, action='append', default=[], metavar='V',
        help='X Y Z ... (m), or X Y Z QX QY QZ QW ...; may be repeated',
    )  # fmt: skip
    parser.add_argument('--points', help='CSV file of points (x,y,z[,qx,qy,qz,qw])')
    parser.add_argument('--order', type=int, default=1, help='joints that fail at once')
    parser.add_argument('--mode', choices=MODES, default='position')
    parser.add_argument('--tolerance', type=float, default=1e-6, help='reach tolerance (m)')
    parser.add_argument('--seed', type=int, default=0, help='of the posture searches')
    parser.add_argument('--threads', type=int, default=os.cpu_count() or 1)
    parser.add_argument('--margin', action='store_true', help='also find the proved ball')
    parser.add_argument('--certificate', metavar='FILE', help='keep the proofs (JSON)')
    parser.add_argument(
        '--lookup',
        metavar='MAP.npz',
        help='ask this map (of --grid ... --map) first, the engine only where it does not know',
    )
    _add_map_options(parser.add_argument_group('maps'))
    parser.add_argument('--json', action='store_true', help='one JSON object a line')


def _add_map_options(group: Any) -> None:
    group.add_argument(
        '--grid', choices=GRIDS, help='map a slice, the half plane of revolution, or a volume'
    )
    group.add_argument('--at', type=float, default=0.0, help="a slice's third coordinate (m)")
    group.add_argument(
        '--bounds', nargs='+', type=float, metavar='V', help='LOW HIGH of each coordinate (m)'
    )
    group.add_argument('--depth', type=int, default=7, help='2^DEPTH cells a coordinate')
    group.add_argument('--plot', metavar='OUT.png', help='picture of the map')
    group.add_argument('--map', metavar='OUT', help='write the map, .npz or .csv')


def run(args: argparse.Namespace) -> int:
    """Judge and print."""
    arm = load_arm(args.arm, base=args.base, tip=args.tip)
    if args.grid:
        return _run_map(args, arm)
    if args.plot or args.map:
        raise InputError('--grid', f'is missing; --plot and --map need one of {", ".join(GRIDS)}')
    points = [row for values in args.point for row in _rows(values, args.mode)]
    if args.points:
        points.extend(read_points(args.points))
    if not points:
        raise InputError('--point', 'is missing; give --point X Y Z or --points FILE.csv')
    width = {len(row) for row in points}
    if len(width) > 1:
        raise InputError('--point', 'mixes positions and poses; give 3 numbers each, or 7 each')
    rows = np.array(points)
    settings = FtwsSettings(tolerance=args.tolerance, seed=args.seed, margin=args.margin)
    ask = partial(query, arm, order=args.order, mode=args.mode)
    if args.lookup:
        ask = partial(query_with_map, _map_for(args, arm, rows), arm)
    if args.certificate:
        results, document = certify(arm, rows, order=args.order, mode=args.mode, settings=settings)
        save_certificate(document, args.certificate)
        for result in results:
            print(json.dumps(result.to_json()) if args.json else describe(result), flush=True)
        return 0
    for start in range(0, len(rows), _BATCH):
        batch = rows[start : start + _BATCH]
        for result in ask(batch, settings=settings, threads=args.threads):
            print(json.dumps(result.to_json()) if args.json else describe(result), flush=True)
    return 0


def _map_for(args: argparse.Namespace, arm: SerialChain, rows: Array) -> FtwsMap:
    """Map of ``--lookup``, if it can answer what is asked."""
    if args.mode != 'position' or rows.shape[1] != 3 or args.margin or args.certificate:
        raise InputError('--lookup', 'answers positions, without margins and certificates')
    ftws_map = load_map(args.lookup, arm)
    if ftws_map.order != args.order:
        raise InputError('--order', f'is {args.order}; the map is of order {ftws_map.order}')
    return ftws_map


def _run_map(args: argparse.Namespace, arm: SerialChain) -> int:
    """Build, measure and write a map."""
    if args.point or args.points or args.certificate:
        raise InputError('--grid', 'maps a region; ask about points without it')
    if args.mode != 'position':
        raise InputError('--mode', f'is {args.mode!r}; maps are of positions')
    frame = map_frame(arm, args.grid, args.at)
    bounds = args.bounds or []
    if bounds and len(bounds) != 2 * frame.dimension:
        raise InputError('--bounds', f'needs {2 * frame.dimension} numbers for --grid {args.grid}')
    with tqdm(unit='cell', disable=None) as bar:

        def progress(done: int, total: int) -> None:
            bar.total = total
            bar.n = done
            bar.refresh()

        ftws_map = build_map(
            arm, frame, low=bounds[::2] or None, high=bounds[1::2] or None, depth=args.depth,
            order=args.order, tolerance=args.tolerance, threads=args.threads, progress=progress,
        )  # fmt: skip
    lower, upper = ftws_map.measure()
    if args.map:
        ftws_map.save(args.map)
    if args.plot:
        # Loaded only here: matplotlib takes half a second to import.
        from ft_manip_ros.core.ftws.map_plot import plot_map

        plot_map(ftws_map, args.plot)
    if args.json:
        print(
            json.dumps(
                {'grid': args.grid, 'lower': lower, 'upper': upper, 'complete': ftws_map.complete}
            )
        )
    else:
        unit = ftws_map.frame.unit
        what = {'m^2': 'area', 'm^3': 'volume'}[unit]
        print(f'{what} proved between {lower:.6g} and {upper:.6g} {unit}')
        if not ftws_map.complete:
            print('interrupted: the map is right but coarse')
    return 0 if ftws_map.complete else 130


def _rows(values: list[float], mode: str) -> list[list[float]]:
    """Points or poses out of the numbers behind one ``--point``."""
    width = 7 if len(values) % 7 == 0 and (mode == 'pose' or len(values) % 3 != 0) else 3
    if len(values) % width != 0:
        raise InputError('--point', f'has {len(values)} numbers; 3 a point or 7 a pose are needed')
    if not np.isfinite(values).all():
        raise InputError('--point', 'contains NaN or infinity')
    return [values[k : k + width] for k in range(0, len(values), width)]


def describe(result: FtwsResult) -> str:
    """Return the answer as a person reads it."""
    x, y, z = result.point
    lines = [f'({x:g}, {y:g}, {z:g})  {result.verdict.value.upper()}: {result.reason}']
    if result.joints:
        at = ', '.join(
            f'{name} at {angle:.4f}'
            for name, angle in zip(result.joints, result.angles, strict=True)
        )
        lines.append(f'    worst: {at} (residual {result.residual:.3g} m)')
    if result.margin > 0.0:
        lines.append(f'    holds for a ball of {result.margin:.3g} m around the point')
    for name, share in result.surviving_fraction.items():
        if share < 1.0:
            parts = ' '.join(f'[{lo:.3f}, {hi:.3f}]' for lo, hi in result.tolerated[name])
            lines.append(f'    {name}: tolerated {share:.1%}  {parts}')
    return '\n'.join(lines)
