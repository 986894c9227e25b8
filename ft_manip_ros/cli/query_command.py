"""`ftmanip query`: ask the running workspace node, and read its answer as a person would."""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from typing import TYPE_CHECKING, Any

from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.verdict import FtwsResult, Verdict

if TYPE_CHECKING:
    from ft_manip_interfaces.srv import QueryFtws

# A request that is sent in the moment between our seeing the node and its seeing us is lost.
_SETTLE_TIME = 0.2  # s

MODES = ('position', 'pose', 'dextrous')


def add_parser(subparsers: Any) -> None:
    """Add the sub-command."""
    parser = subparsers.add_parser(
        'query',
        help='ask the running workspace node about points',
        description='Ask the running workspace node whether points or poses stay reachable '
        'whichever joint locks. Exit code 0: answered; 1: no node answered; 2: bad input.',
        epilog='Negative numbers: put -- before them, as in: ftmanip query -- -0.3 0.2 0.5',
    )
    parser.add_argument(
        'values', nargs='+', type=float, metavar='X Y Z', help='points (m); with --mode pose: '
        'X Y Z QX QY QZ QW each'
    )  # fmt: skip
    parser.add_argument('--mode', choices=MODES, default='position', help='what has to be reached')
    parser.add_argument('--order', type=int, default=1, help='joints that fail at once')
    parser.add_argument('--tolerance', type=float, default=0.0, help='reach tolerance (m)')
    parser.add_argument('--budget', type=float, default=0.0, help='time for all points (s)')
    parser.add_argument('--namespace', default='', help='namespace of the workspace node')
    parser.add_argument('--wait', type=float, default=10.0, help='how long to wait for it (s)')
    parser.add_argument('--json', action='store_true', help='one JSON object a line')


def run(arguments: argparse.Namespace) -> int:
    """Ask, print, and say by the exit code whether there was an answer."""
    rows = _rows(arguments.values, 7 if arguments.mode == 'pose' else 3)
    for key in ('order', 'tolerance', 'budget'):
        value = getattr(arguments, key)
        if not (math.isfinite(value) and value >= 0):
            raise InputError(f'--{key}', f'is {value}; must be finite and not negative')
    response = _ask(rows, arguments)
    if response is None:
        print(
            f'no workspace node answered within {arguments.wait:g} s: is it running and active?',
            file=sys.stderr,
        )
        return 1
    if not response.success:
        raise InputError('workspace', response.message)
    from ft_manip_ros.nodes.ftws_messages import answer_from_message

    for message in response.answers:
        result = answer_from_message(message, response.joint_names)
        print(json.dumps(result.to_json()) if arguments.json else in_words(result))
    return 0


def in_words(result: FtwsResult) -> str:
    """Answer on one point as a person reads it."""
    point = '({:g}, {:g}, {:g})'.format(*result.point)
    if result.verdict is Verdict.MEMBER:
        lines = [f'{point}  MEMBER: reachable whichever joint locks, at whichever angle']
        if result.margin > 0.0:
            lines.append(f'    proved for every point within {result.margin * 1e3:.3g} mm')
    elif result.verdict is Verdict.NON_MEMBER:
        witness = ' and '.join(
            f'{name} locks at {math.degrees(angle):.1f} deg ({angle:.4f})'
            for name, angle in zip(result.joints, result.angles, strict=True)
        )
        lines = [f'{point}  NOT A MEMBER: lost when {witness}']
        lines.append(f'    the arm then misses it by at least {result.residual * 1e3:.3g} mm')
    else:
        lines = [f'{point}  UNDECIDED: {result.reason}']
    for name, share in result.surviving_fraction.items():
        if share < 1.0:
            spans = ', '.join(
                f'[{math.degrees(lower):.1f}, {math.degrees(upper):.1f}]'
                for lower, upper in result.tolerated.get(name, ())
            )
            where = f'in {share:.1%} of its range, deg: {spans}' if spans else 'nowhere'
            lines.append(f'    {name} may lock {where}')
    return '\n'.join(lines)


def _rows(values: list[float], width: int) -> list[list[float]]:
    if len(values) % width:
        raise InputError('points', f'are {len(values)} numbers; {width} are needed for each')
    if not all(math.isfinite(value) for value in values):
        raise InputError('points', 'contain NaN or infinity')
    return [values[i : i + width] for i in range(0, len(values), width)]


def _ask(rows: list[list[float]], arguments: argparse.Namespace) -> QueryFtws.Response | None:
    import rclpy
    from geometry_msgs.msg import Point, Pose, Quaternion
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    from ft_manip_interfaces.srv import QueryFtws
    from ft_manip_ros.nodes.managed_node import NOT_ACTIVE
    from ft_manip_ros.nodes.topics import QUERY_FTWS

    request = QueryFtws.Request(
        poses=[
            Pose(
                position=Point(x=row[0], y=row[1], z=row[2]),
                orientation=Quaternion(x=row[3], y=row[4], z=row[5], w=row[6])
                if len(row) == 7
                else Quaternion(w=1.0),
            )
            for row in rows
        ],
        mode=arguments.mode,
        order=arguments.order,
        tolerance=arguments.tolerance,
        time_budget=arguments.budget,
        intervals=True,
    )
    name = f'{arguments.namespace.rstrip("/")}/{QUERY_FTWS}' if arguments.namespace else QUERY_FTWS
    # Ctrl-C is ours: rclpy's handler would shut the context down while it is cleaned up here.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('ftmanip_query', enable_rosout=False)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    client = node.create_client(QueryFtws, name)
    deadline = time.monotonic() + arguments.wait
    settled = time.monotonic() + _SETTLE_TIME
    try:
        while time.monotonic() < deadline:
            if not client.service_is_ready():
                executor.spin_once(timeout_sec=0.05)
                settled = time.monotonic() + _SETTLE_TIME
                continue
            if time.monotonic() < settled:
                executor.spin_once(timeout_sec=0.05)
                continue
            future = client.call_async(request)
            # The node itself bounds the time of an answer; only its death leaves us waiting.
            while not future.done() and client.service_is_ready():
                executor.spin_once(timeout_sec=0.5)
            answer = future.result() if future.done() else None
            if answer is not None and not answer.message.endswith(NOT_ACTIVE):
                return answer
            executor.spin_once(timeout_sec=0.1)
        return None
    finally:
        executor.shutdown(timeout_sec=0.0)
        node.destroy_node()
        rclpy.try_shutdown()
