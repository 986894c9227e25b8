"""The ring buffer: only what surrounds a trigger is kept, in bounded memory."""

from __future__ import annotations

from pathlib import Path

import pytest
from std_msgs.msg import String

from ft_manip_ros.bags.definitions import message_definition
from ft_manip_ros.bags.qos import LATCHED, SENSOR_DATA
from ft_manip_ros.bags.reader import Bag, open_bag
from ft_manip_ros.bags.recording import MESSAGE_OVERHEAD, Recorded
from ft_manip_ros.bags.snapshot import SnapshotRecording
from ft_manip_ros.bags.writer_settings import WriterSettings
from ft_manip_ros.core.errors import InputError
from support.cdr import cdr

STRING = 'std_msgs/msg/String'
DATA = cdr(String(data='x' * 80))
SECOND = 1_000_000_000
PERIOD = SECOND // 100


def snapshots(folder: Path, capacity: int = 1 << 24) -> SnapshotRecording:
    made = SnapshotRecording(
        folder, WriterSettings(flush_interval=0.05), before=2.0, after=1.0, capacity=capacity
    )
    made.add_provenance('ft_manip_ros', {'seed': '1'})
    made.add_topic('/states', message_definition(STRING), (SENSOR_DATA,))
    made.add_topic('/task', message_definition(STRING), (LATCHED,))
    return made


def state(stamp: int) -> Recorded:
    return Recorded('/states', STRING, stamp, stamp, DATA)


def task(stamp: int) -> Recorded:
    return Recorded('/task', STRING, stamp, stamp, cdr(String(data=f'task at {stamp}')))


def bags(folder: Path) -> list[Bag]:
    return [open_bag(path) for path in sorted(folder.iterdir())]


def feed(made: SnapshotRecording, start: int, end: int) -> None:
    for stamp in range(start, end, PERIOD):
        made.put([state(stamp)])


def test_before_and_after_a_trigger_and_the_last_latched_message(tmp_path: Path) -> None:
    made = snapshots(tmp_path)
    made.put([task(SECOND)])
    made.put([task(2 * SECOND)])
    feed(made, 10 * SECOND, 20 * SECOND)
    made.trigger(20 * SECOND)
    feed(made, 20 * SECOND, 30 * SECOND)
    status = made.close(20.0)
    (bag,) = bags(tmp_path)
    assert bag.notes == []
    assert [bag.decode(m).data for m in bag.messages(['/task'])] == [f'task at {2 * SECOND}']
    stamps = [m.log_time for m in bag.messages(['/states'])]
    assert stamps == list(range(18 * SECOND - PERIOD, 21 * SECOND + 1, PERIOD))
    assert bag.provenance['ft_manip_ros'] == {'seed': '1'}
    assert status.written == len(stamps) + 1
    assert not status.dropped


def test_a_second_trigger_prolongs_and_a_later_one_begins_anew(tmp_path: Path) -> None:
    made = snapshots(tmp_path)
    feed(made, 0, 5 * SECOND)
    made.trigger(5 * SECOND)
    feed(made, 5 * SECOND, 5 * SECOND + SECOND // 2)
    made.trigger(5 * SECOND + SECOND // 2)
    feed(made, 5 * SECOND + SECOND // 2, 50 * SECOND)
    made.trigger(50 * SECOND)
    feed(made, 50 * SECOND, 52 * SECOND)
    made.close(20.0)
    first, second = bags(tmp_path)
    assert (first.start, first.end) == (3 * SECOND - PERIOD, 6 * SECOND + SECOND // 2)
    assert (second.start, second.end) == (48 * SECOND - PERIOD, 51 * SECOND)


def test_without_a_trigger_there_is_no_bag(tmp_path: Path) -> None:
    made = snapshots(tmp_path / 'out')
    feed(made, 0, 20 * SECOND)
    assert made.close().written == 0
    assert not (tmp_path / 'out').exists()


def test_memory_is_bounded_whatever_comes(tmp_path: Path) -> None:
    capacity = 100 * (len(DATA) + MESSAGE_OVERHEAD)
    made = snapshots(tmp_path, capacity)
    for stamp in range(20_000):
        made.put([state(stamp)])
        assert made.status().queued_bytes <= capacity
    made.trigger(20_000)
    made.close(20.0)
    (bag,) = bags(tmp_path)
    assert [m.log_time for m in bag.messages(['/states'])] == list(range(19_900, 20_000))


@pytest.mark.parametrize('key', ['before', 'after'])
def test_bad_times_are_named(tmp_path: Path, key: str) -> None:
    times = {'before': 1.0, 'after': 1.0, key: float('nan')}
    with pytest.raises(InputError, match=key):
        SnapshotRecording(tmp_path, WriterSettings(), capacity=1, **times)
