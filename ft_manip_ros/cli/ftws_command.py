"""`ftmanip ftws`: judge points or poses against the fault-tolerant work space of an arm."""

from __future__ import annotations

import argparse
import json
import os
from typing import Any

import numpy as np

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.certificate import certify, save_certificate
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
        help='X Y Z (m), or X Y Z QX QY QZ QW; may be repeated',
    )  # fmt: skip
    parser.add_argument('--points', help='CSV file of points (x,y,z[,qx,qy,qz,qw])')
    parser.add_argument('--order', type=int, default=1, help='joints that fail at once')
    parser.add_argument('--mode', choices=MODES, default='position')
    parser.add_argument('--tolerance', type=float, default=1e-6, help='reach tolerance (m)')
    parser.add_argument('--seed', type=int, default=0, help='of the posture searches')
    parser.add_argument('--threads', type=int, default=os.cpu_count() or 1)
    parser.add_argument('--margin', action='store_true', help='also find the proved ball')
    parser.add_argument('--certificate', metavar='FILE', help='keep the proofs (JSON)')
    parser.add_argument('--json', action='store_true', help='one JSON object a line')


def run(args: argparse.Namespace) -> int:
    """Judge and print."""
    arm = load_arm(args.arm, base=args.base, tip=args.tip)
    points = [_row(values) for values in args.point]
    if args.points:
        points.extend(read_points(args.points))
    if not points:
        raise InputError('--point', 'is missing; give --point X Y Z or --points FILE.csv')
    width = {len(row) for row in points}
    if len(width) > 1:
        raise InputError('--point', 'mixes positions and poses; give 3 numbers each, or 7 each')
    rows = np.array(points)
    settings = FtwsSettings(tolerance=args.tolerance, seed=args.seed, margin=args.margin)
    if args.certificate:
        results, document = certify(arm, rows, order=args.order, mode=args.mode, settings=settings)
        save_certificate(document, args.certificate)
        for result in results:
            print(json.dumps(result.to_json()) if args.json else describe(result), flush=True)
        return 0
    for start in range(0, len(rows), _BATCH):
        for result in query(
            arm, rows[start : start + _BATCH], order=args.order, mode=args.mode,
            settings=settings, threads=args.threads,
        ):  # fmt: skip
            print(json.dumps(result.to_json()) if args.json else describe(result), flush=True)
    return 0


def _row(values: list[float]) -> list[float]:
    if len(values) not in (3, 7):
        raise InputError('--point', f'has {len(values)} numbers; 3 (x y z) or 7 are needed')
    if not np.isfinite(values).all():
        raise InputError('--point', 'contains NaN or infinity')
    return values


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
