"""A hundred recorder nodes killed at random moments; messages counted against what was sent.

Each recorder records a topic of its own, whose publisher keeps everything for those who join late:
all that it has ever sent has to be in the bag, up to the flush interval before the kill. The clock
runs from the first message on disk, since only then the middleware is known to deliver. The bag is
read three ways: by this package as it lies there, by what ``ftmanip bag recover`` makes of it, and
by the streaming reader of the ``mcap`` library alone.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import signal
import struct
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rclpy
from mcap.exceptions import McapError
from mcap.records import Message
from mcap.stream_reader import StreamReader
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Int64

from ft_manip_ros.bags.copy import copy_bag
from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.nodes.demo_domain import own_domain
from ft_manip_ros.nodes.recorder import main as recorder

KILLS = int(os.environ.get('BENCH_BAG_KILLS', '100'))
AT_ONCE = 3
RATE = 200.0
FLUSH = 1.0  # s, the default
# From the publisher's call to the disk: middleware, the recorder's poll, its writer's turn.
SLACK = 0.25
LONGEST = 2.5  # s, from the first message on disk to the kill
_MOST = 4000  # messages of a topic
_SLOT = 8 * (_MOST + 2)  # bytes: state, count, sending times


@dataclass(frozen=True)
class Kill:
    """What one kill left: messages sent, read back, lost though due, and the ages in s."""

    sent: int
    kept: int
    due_lost: int
    oldest_lost: float
    alone: int
    recovered: int


def run() -> None:
    """Kill, count, print."""
    shared = mmap.mmap(-1, KILLS * _SLOT)
    rng = np.random.default_rng(0)
    moments = rng.uniform(0.0, LONGEST, KILLS)
    began = time.monotonic()
    with own_domain(None), tempfile.TemporaryDirectory() as scratch:
        publisher = _fork(lambda: _publish(shared))
        try:
            with ThreadPoolExecutor(AT_ONCE) as pool:
                kills = list(
                    pool.map(
                        lambda k: _kill(shared, k, float(moments[k]), Path(scratch)), range(KILLS)
                    )
                )
        finally:
            os.kill(publisher, signal.SIGKILL)
            os.waitpid(publisher, 0)
        print(f'{KILLS} recorders killed within {LONGEST:g} s of their first message on disk')
        print(f'sent to them          {sum(kill.sent for kill in kills):>8}')
        print(f'in the bags           {sum(kill.kept for kill in kills):>8}')
        print(f'lost though older than {FLUSH + SLACK:g} s  {sum(k.due_lost for k in kills):>3}')
        print(f'oldest message lost   {max(kill.oldest_lost for kill in kills):>8.2f} s')
        alone = sum(kill.alone == kill.kept for kill in kills)
        print(f'mcap alone reads the same       {alone:>4} of {KILLS} bags')
        same = sum(kill.recovered == kill.kept for kill in kills)
        print(f'ftmanip bag recover keeps all   {same:>4} of {KILLS} bags')
        print(f'{time.monotonic() - began:.0f} s in all')


def _fork(work: Callable[[], object]) -> int:
    child = os.fork()
    if child:
        return child
    sink = os.open(os.devnull, os.O_WRONLY)
    for number in (1, 2):
        os.dup2(sink, number)
    try:
        work()
    finally:
        os._exit(0)


def _publish(shared: mmap.mmap) -> None:
    """Send numbered messages on the topics whose recorder has been found, until it is dead."""
    rclpy.init(args=[])
    node = rclpy.create_node('bench_publisher')
    qos = QoSProfile(depth=_MOST, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    topics: dict[int, Publisher] = {}
    start, i = time.monotonic(), 0
    while True:
        for k in range(KILLS):
            state, count = struct.unpack_from('<QQ', shared, k * _SLOT)
            if state == 1 and k not in topics:
                topics[k] = node.create_publisher(Int64, f'count_{k}', qos)
            publisher = topics.get(k)
            if state == 2 and publisher is not None:
                node.destroy_publisher(publisher)
                del topics[k]
            elif publisher is not None and count < _MOST and publisher.get_subscription_count():
                at = k * _SLOT + 16 + 8 * count
                struct.pack_into('<Q', shared, at, time.monotonic_ns())
                publisher.publish(Int64(data=count))
                struct.pack_into('<Q', shared, k * _SLOT + 8, count + 1)
        i += 1
        time.sleep(max(start + i / RATE - time.monotonic(), 0.0))


def _kill(shared: mmap.mmap, k: int, moment: float, scratch: Path) -> Kill:
    """Start a recorder, wait for its first message and the moment, kill it and count."""
    folder = scratch / f'bag_{k}'
    parameters = [f'output:={folder}', f'topics:=[count_{k}]', 'services:=[""]']
    arguments = [word for text in parameters for word in ('-p', text)]
    struct.pack_into('<Q', shared, k * _SLOT, 1)
    child = _fork(lambda: recorder(['--ros-args', *arguments]))
    while not (list(folder.glob('*.mcap')) and open_bag(folder).message_count):
        time.sleep(0.05)
    time.sleep(moment)
    killed = time.monotonic_ns()
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    (sent,) = struct.unpack_from('<Q', shared, k * _SLOT + 8)
    struct.pack_into('<Q', shared, k * _SLOT, 2)
    times = struct.unpack_from(f'<{sent}Q', shared, k * _SLOT + 16)
    bag = open_bag(folder)
    found = {bag.decode(message).data for message in bag.messages()}
    lost = [(killed - times[n]) * 1e-9 for n in range(sent) if n not in found]
    copy_bag(bag, scratch / f'recovered_{k}')
    recovered = open_bag(scratch / f'recovered_{k}').message_count
    return Kill(
        sent,
        len(found),
        sum(age > FLUSH + SLACK for age in lost),
        max(lost, default=0.0),
        sum(_read_alone(file) for file in folder.glob('*.mcap')),
        recovered,
    )


def _read_alone(path: Path) -> int:
    """Messages that the mcap library's streaming reader gives before the file breaks off."""
    count = 0
    with path.open('rb') as file, contextlib.suppress(McapError, struct.error, ValueError):
        for record in StreamReader(file).records:
            count += isinstance(record, Message)
    return count
