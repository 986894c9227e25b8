"""The recording thread: bounded memory, drops counted, a disk that refuses."""

from __future__ import annotations

import errno
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from std_msgs.msg import String

from ft_manip_ros.bags.definitions import message_definition
from ft_manip_ros.bags.mcap_file import WholeRecordFile
from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.bags.recording import MESSAGE_OVERHEAD, Recorded, Recording
from ft_manip_ros.bags.writer import BagWriter
from ft_manip_ros.bags.writer_settings import WriterSettings
from ft_manip_ros.core.errors import InputError
from support.cdr import cdr

STRING = 'std_msgs/msg/String'
DATA = cdr(String(data='x' * 80))


def message(i: int, topic: str = '/text') -> Recorded:
    return Recorded(topic, STRING, i, i, DATA)


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def recording(folder: Path, capacity: int = 1 << 20) -> Recording:
    made = Recording(BagWriter(folder, WriterSettings(flush_interval=0.05)), capacity)
    for topic in ('/text', '/other'):
        made.add_topic(topic, message_definition(STRING), ())
    return made


def test_everything_put_is_in_the_bag_in_order(tmp_path: Path) -> None:
    made = recording(tmp_path / 'bag')
    for start in range(0, 1000, 10):
        made.put([message(i) for i in range(start, start + 10)])
    made.add_provenance('late', {'key': 'value'})
    made.add_attachment('late.txt', 'text/plain', b'content')
    status = made.close()
    assert (status.received, status.written, status.error) == (1000, 1000, '')
    bag = open_bag(tmp_path / 'bag')
    assert [m.log_time for m in bag.messages()] == list(range(1000))
    assert bag.provenance['late'] == {'key': 'value'}
    assert bag.attachments['late.txt'] == ('text/plain', b'content')


def test_a_slow_disk_costs_counted_messages_and_no_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate = threading.Event()
    original = WholeRecordFile.write

    def slow(file: WholeRecordFile, data: bytes) -> int:
        gate.wait(20.0)
        return original(file, data)

    gate.set()
    size = len(DATA) + MESSAGE_OVERHEAD
    made = recording(tmp_path / 'bag', capacity=50 * size)
    monkeypatch.setattr(WholeRecordFile, 'write', slow)
    gate.clear()
    made.put([message(1000)])
    time.sleep(0.3)  # the thread now waits for the disk with the first message in hand
    made.put([message(i) for i in range(100)] + [message(i, '/other') for i in range(20)])
    status = made.status()
    assert status.queued_bytes <= 50 * size
    assert sum(status.dropped.values()) == 121 - 1 - 50
    assert status.dropped['/other'] == 20
    gate.set()
    final = made.close(20.0)
    assert final.written == final.received - sum(final.dropped.values())
    assert open_bag(tmp_path / 'bag').message_count == final.written


def test_a_disk_that_refuses_and_recovers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    full = threading.Event()
    original = WholeRecordFile.write

    def write(file: WholeRecordFile, data: bytes) -> int:
        if full.is_set():
            raise OSError(errno.ENOSPC, 'No space left on device')
        return original(file, data)

    monkeypatch.setattr(WholeRecordFile, 'write', write)
    made = recording(tmp_path / 'bag')
    made.put([message(i) for i in range(100)])
    wait_until(lambda: made.status().written == 100)
    full.set()
    made.put([message(i) for i in range(100, 200)])
    wait_until(lambda: 'No space left' in made.status().error)
    assert open_bag(tmp_path / 'bag').message_count == 100
    full.clear()
    made.put([message(i) for i in range(200, 300)])
    wait_until(lambda: made.status().written == 300)
    assert made.close().error == ''
    assert [m.log_time for m in open_bag(tmp_path / 'bag').messages()] == list(range(300))


def test_a_disk_that_stays_full_is_reported_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = recording(tmp_path / 'bag')
    made.put([message(i) for i in range(10)])
    wait_until(lambda: made.status().written == 10)

    def refuse(file: WholeRecordFile, data: bytes) -> int:
        raise OSError(errno.ENOSPC, 'No space left on device')

    monkeypatch.setattr(WholeRecordFile, 'write', refuse)
    made.put([message(i) for i in range(10, 20)])
    status = made.close()
    assert 'No space left' in status.error
    assert (status.received, status.written) == (20, 10)
    assert open_bag(tmp_path / 'bag').message_count == 10
    assert not (tmp_path / 'bag' / 'metadata.yaml').exists()


def test_a_defect_in_the_thread_does_not_pass_unseen(tmp_path: Path) -> None:
    made = recording(tmp_path / 'bag')
    made.put([message(1), message(-1)])  # no clock gives a negative time
    wait_until(lambda: 'recording ended' in made.status().error)
    made.put([message(2)])
    assert 'recording ended' in made.close().error


def test_capacity_must_be_positive(tmp_path: Path) -> None:
    with pytest.raises(InputError, match='capacity'):
        Recording(BagWriter(tmp_path / 'bag'), 0)
