"""Snapshot mode: memory over hours of 1 kHz joint states with a fault every ten minutes."""

from __future__ import annotations

import resource
import tempfile
import time
from pathlib import Path

from bench.bench_bags import RATE, TYPE, joint_states
from ft_manip_ros.bags.definitions import message_definition
from ft_manip_ros.bags.qos import SENSOR_DATA
from ft_manip_ros.bags.recording import Recorded
from ft_manip_ros.bags.snapshot import SnapshotRecording
from ft_manip_ros.bags.writer_settings import WriterSettings

HOURS = 1.0
CAPACITY = 64 << 20
_SECOND = 1_000_000_000
_BATCH = 20  # messages, as the recorder takes them at 1 kHz


def run() -> None:
    """Feed the ring as fast as it goes, with stamps of the time that it stands for."""
    count = round(HOURS * 3600 * RATE)
    data = joint_states(1000)
    with tempfile.TemporaryDirectory() as scratch:
        recording = SnapshotRecording(
            Path(scratch), WriterSettings(), before=10.0, after=5.0, capacity=CAPACITY
        )
        recording.add_topic('/joint_states', message_definition(TYPE), (SENSOR_DATA,))
        print(f'{"minutes":>8}{"snapshots":>11}{"ring MiB":>10}{"peak memory MiB":>17}')
        begin = time.process_time()
        for first in range(0, count, _BATCH):
            stamps = [i * _SECOND // RATE for i in range(first, first + _BATCH)]
            recording.put(
                [
                    Recorded('/joint_states', TYPE, stamp, stamp, data[(first + k) % 1000])
                    for k, stamp in enumerate(stamps)
                ]
            )
            if first % (600 * RATE) == 300 * RATE:
                recording.trigger(stamps[-1])
            if first % (600 * RATE) == 600 * RATE - _BATCH:
                _row(stamps[-1], recording)
        took = time.process_time() - begin
        recording.close(30.0)
        print(f'{took / count * 1e6:.1f} us of CPU a message')


def _row(stamp: int, recording: SnapshotRecording) -> None:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    ring = recording.status().queued_bytes / (1 << 20)
    print(f'{stamp / _SECOND / 60:>8.0f}{recording.count:>11}{ring:>10.1f}{peak / 1024:>17.0f}')
