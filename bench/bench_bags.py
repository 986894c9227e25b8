"""Bags: recording at 1 kHz, size and speed of writing beside rosbags."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from sensor_msgs.msg import JointState

from ft_manip_ros.bags.definitions import message_definition
from ft_manip_ros.bags.qos import SENSOR_DATA
from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.bags.writer import BagWriter
from ft_manip_ros.bags.writer_settings import WriterSettings
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.joint_path import JointPath
from ft_manip_ros.core.sim import SimSettings, SimulatedArm
from ft_manip_ros.nodes.demo_domain import own_domain

DURATION = float(os.environ.get('BENCH_BAGS_SECONDS', '60'))
RATE = 1000
# Arm, base and tip.
ARM = (
    'package://example-robot-data/robots/panda_description/urdf/panda.urdf',
    'panda_link0',
    'panda_hand_tcp',
)
TYPE = 'sensor_msgs/msg/JointState'
ROOT = Path(__file__).resolve().parents[1]
_SECOND = 1_000_000_000
_MIB = 1 << 20


def run() -> None:
    """Print all tables."""
    messages = joint_states(round(DURATION * RATE))
    raw = sum(len(data) for data in messages)
    per_minute = 60.0 / DURATION / _MIB
    print(f'{len(messages)} joint states of 7 joints at {RATE} Hz, {raw * per_minute:.1f} MiB/min')
    print('\nRecorded live, with tasks, faults, plans and the logs of the nodes beside it:')
    print(f'{"":<22}{"sent":>9}{"lost":>7}{"CPU":>8}{"MiB/min":>10}{"of raw":>8}')
    for compression in ('zstd', 'none'):
        live(compression, raw)
    print('\nWritten as fast as it goes:')
    print(f'{"":<22}{"us/message":>12}{"MiB/min":>10}{"of raw":>8}')
    offline(messages, raw)


def motion(chain: SerialChain, count: int) -> tuple[Array, Array]:
    """Times (s) and postures of a motion that lasts ``count`` samples: a posture every 4 s."""
    rng = np.random.default_rng(0)
    middle, half = 0.5 * (chain.lower + chain.upper), 0.5 * (chain.upper - chain.lower)
    postures = middle + 0.6 * half * rng.uniform(-1.0, 1.0, (max(count // 4000, 2) + 1, chain.n))
    return np.arange(len(postures), dtype=np.float64) * 4.0, postures


def joint_states(count: int) -> list[bytes]:
    """Joint states of a moving 7-DOF arm with noise, as they go over the wire."""
    chain = load_arm(ARM[0], base=ARM[1], tip=ARM[2])
    arm = SimulatedArm(chain, SimSettings())
    arm.follow(JointPath(chain.joint_names, *motion(chain, count), None, None))
    found = []
    for i in range(count):
        arm.advance(i / RATE)
        position, velocity = arm.measure()
        message = JointState(name=list(chain.joint_names), position=position.tolist())
        message.velocity, message.effort = velocity.tolist(), [0.0] * chain.n
        message.header.stamp.sec, message.header.stamp.nanosec = 1 + i // RATE, i % RATE * 10**6
        found.append(serialize_message(message))
    return found


def live(compression: str, raw: int) -> None:
    """Run the recorder against a publisher in another process and count."""
    with own_domain(None), tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / 'bag'
        node = [sys.executable, '-m', 'ft_manip_ros.nodes.recorder', '--ros-args']
        node += ['-p', f'output:={folder}', '-p', f'compression:={compression}']
        log = open(Path(scratch) / 'log', 'w')  # noqa: SIM115
        recorder = subprocess.Popen(node, stdout=log, stderr=subprocess.STDOUT)
        publisher = subprocess.Popen(
            [sys.executable, '-m', 'bench.bag_publisher', str(DURATION), str(RATE)],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert publisher.stdout is not None
        publisher.stdout.readline()  # it has found the recorder
        watched = psutil.Process(recorder.pid)
        before, began = watched.cpu_times(), time.monotonic()
        sent = int(publisher.stdout.readline())
        after, took = watched.cpu_times(), time.monotonic() - began
        publisher.wait()
        time.sleep(1.0)
        recorder.terminate()
        recorder.wait()
        log.close()
        bag = open_bag(folder)
        kept = bag.topics['/joint_states'].count
        size = sum(path.stat().st_size for path in folder.glob('*.mcap'))
        cpu = (after.user + after.system - before.user - before.system) / took
        print(
            f'{compression:<22}{sent:>9}{sent - kept:>7}{cpu:>7.1%}'
            f'{size * 60.0 / took / _MIB:>10.2f}{size / raw:>8.1%}'
        )


def offline(messages: list[bytes], raw: int) -> None:
    """Write the same messages with this package and with rosbags."""
    definition = message_definition(TYPE)
    with tempfile.TemporaryDirectory() as scratch:
        for compression in ('zstd', 'lz4', 'none'):
            folder = Path(scratch) / compression
            start = time.perf_counter()
            with BagWriter(folder, WriterSettings(compression=compression)) as writer:
                key = writer.add_topic('/joint_states', definition, (SENSOR_DATA,))
                for i, data in enumerate(messages):
                    writer.write(key, data, i * _SECOND // RATE)
                    if i % 20 == 0:
                        writer.tick()
            _row(f'this package, {compression}', folder, start, len(messages), raw)
        for plugin in (StoragePlugin.MCAP, StoragePlugin.SQLITE3):
            folder = Path(scratch) / plugin.name
            start = time.perf_counter()
            with RosbagsWriter(folder, version=9, storage_plugin=plugin) as other:
                connection = other.add_connection(
                    '/joint_states', TYPE, msgdef=definition.text, rihs01=definition.type_hash
                )
                for i, data in enumerate(messages):
                    other.write(connection, i * _SECOND // RATE, data)
            _row(f'rosbags, {plugin.name.lower()}', folder, start, len(messages), raw)


def _row(name: str, folder: Path, start: float, count: int, raw: int) -> None:
    took = time.perf_counter() - start
    size = sum(path.stat().st_size for path in folder.iterdir())
    print(
        f'{name:<22}{took / count * 1e6:>12.2f}'
        f'{size * 60.0 / DURATION / _MIB:>10.2f}{size / raw:>8.1%}'
    )
