"""A hundred recordings killed at random moments: nothing older than the flush interval is lost."""

from __future__ import annotations

import contextlib
import mmap
import os
import signal
import struct
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.exceptions import McapError
from mcap.records import Message
from mcap.stream_reader import StreamReader
from std_msgs.msg import Int64

from ft_manip_ros.bags.copy import copy_bag
from ft_manip_ros.bags.definitions import message_definition
from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.bags.recording import Recorded, Recording
from ft_manip_ros.bags.writer import BagWriter
from ft_manip_ros.bags.writer_settings import WriterSettings
from support.cdr import cdr

TYPE = 'std_msgs/msg/Int64'
FLUSH = 0.05
# What a loaded machine may add between a message and the writing thread's turn.
SLACK = 0.5


def record_until_killed(folder: Path, shared: mmap.mmap) -> None:
    """Send numbered messages; tell the parent how many were sent and how many written."""
    settings = WriterSettings(flush_interval=FLUSH, chunk_size=4000, split_duration=0.15)
    recording = Recording(BagWriter(folder, settings), 1 << 24)
    recording.add_topic('/count', message_definition(TYPE), ())
    head = cdr(Int64(data=0))[:4]
    for i in range(10**9):
        stamp = time.monotonic_ns()
        data = head + struct.pack('<q', i)
        recording.put([Recorded('/count', TYPE, stamp, stamp, data)])
        shared[0:16] = struct.pack('<QQ', i + 1, recording.status().written)
        if i % 4 == 0:
            time.sleep(0.0005)


def read_with_mcap_alone(path: Path) -> int:
    """Messages that the public library's streaming reader gives before the file breaks off."""
    count = 0
    with path.open('rb') as file, contextlib.suppress(McapError, struct.error, ValueError):
        for record in StreamReader(file).records:
            count += isinstance(record, Message)
    return count


@pytest.mark.parametrize('block', range(4))
def test_killed_recordings_keep_what_was_flushed(tmp_path: Path, block: int) -> None:
    rng = np.random.default_rng(block)
    for k in range(25):
        folder = tmp_path / f'bag_{k}'
        shared = mmap.mmap(-1, 16)
        child = os.fork()
        if child == 0:
            record_until_killed(folder, shared)
        time.sleep(rng.uniform(0.02, 0.35))
        killed = time.monotonic_ns()
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        sent, written = struct.unpack('<QQ', shared[0:16])
        if not list(folder.glob('*.mcap')):
            assert written == 0
            continue
        bag = open_bag(folder)
        stamps = [m.log_time for m in bag.messages()]
        numbers = [bag.decode(m).data for m in bag.messages()]
        assert numbers == list(range(len(numbers)))
        assert written <= len(numbers) <= sent + 1
        assert sum(read_with_mcap_alone(file) for file in folder.glob('*.mcap')) == len(numbers)
        if len(numbers) < sent and stamps:
            assert killed - stamps[-1] < (FLUSH + SLACK) * 1e9
        if numbers:
            copy_bag(bag, tmp_path / f'recovered_{k}')
            assert open_bag(tmp_path / f'recovered_{k}').message_count == len(numbers)
