"""Replay speed as a multiple of real time: committed cases, a minute at 1 kHz, the last demo."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from builtin_interfaces.msg import Duration
from rclpy.serialization import serialize_message
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from bench.bench_bags import ARM, RATE, ROOT, TYPE, joint_states, motion
from ft_manip_ros.bags.definitions import message_definition
from ft_manip_ros.bags.qos import SENSOR_DATA
from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.bags.replay import replay
from ft_manip_ros.bags.writer import BagWriter
from ft_manip_ros.core.arm_file import load_arm

SECONDS = 60
TRAJECTORY = 'trajectory_msgs/msg/JointTrajectory'
_SECOND = 1_000_000_000


def run() -> None:
    """Replay each bag three times after the first; CPU time of opening and replaying."""
    print('CPU time of opening and replaying, best of 3; the first one also loads kernels.')
    print(f'{"":<22}{"recorded":>10}{"messages":>10}{"first":>9}{"best":>9}{"speed":>9}')
    for path in sorted((ROOT / 'bags').glob('*/bag')):
        _row(path.parent.name, path)
    with tempfile.TemporaryDirectory() as scratch:
        _write(Path(scratch) / 'bag')
        _row('1 kHz, 7 joints', Path(scratch) / 'bag')
    demos = sorted((ROOT / 'out').glob('demo_*/bag'))
    if demos:
        _row('last demo', demos[-1])
    else:
        print('last demo: none in out/ (make demo)')


def _row(name: str, path: Path) -> None:
    took, digests = [], set()
    for _ in range(4):
        begin = time.process_time()
        result = replay(open_bag(path))
        took.append(time.process_time() - begin)
        digests.add(result.digest)
    assert len(digests) == 1
    best = min(took[1:])
    print(
        f'{name:<22}{result.duration:>8.1f} s{result.messages:>10}{took[0]:>7.2f} s{best:>7.2f} s'
        f'{result.duration / best:>7.0f} x'
    )


def _write(folder: Path) -> None:
    """A Panda that moves for a minute, with its commands."""
    chain = load_arm(ARM[0], base=ARM[1], tip=ARM[2])
    times, postures = motion(chain, SECONDS * RATE)
    command = JointTrajectory(joint_names=list(chain.joint_names))
    command.header.stamp.sec = 1
    command.points = [
        JointTrajectoryPoint(positions=posture.tolist(), time_from_start=Duration(sec=round(time)))
        for time, posture in zip(times, postures, strict=True)
    ]
    with BagWriter(folder) as writer:
        writer.add_provenance(
            'parameters/fault_monitor', dict(zip(('arm', 'base', 'tip'), ARM, strict=True))
        )
        commands = writer.add_topic(
            '/joint_trajectory_controller/joint_trajectory', message_definition(TRAJECTORY)
        )
        states = writer.add_topic('/joint_states', message_definition(TYPE), (SENSOR_DATA,))
        writer.write(commands, serialize_message(command), _SECOND)
        for i, data in enumerate(joint_states(SECONDS * RATE)):
            writer.write(states, data, _SECOND + i * _SECOND // RATE)
            if i % 1000 == 0:
                writer.flush()
