"""Messages handed on in stretches are those handed on one by one, whatever the file is like."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from ft_manip_ros.bags.reader import Bag, open_bag
from ft_manip_ros.bags.source import BagMessage, Stretch

TOPICS = ('/b', '/a', '/c')
Written = tuple[str, int, bytes]  # topic, log time, data


def write(path: Path, messages: list[Written], *, chunk: int | None) -> None:
    with path.open('wb') as file:
        writer = Writer(
            file,
            chunk_size=chunk or 1,
            compression=CompressionType.NONE,
            use_chunking=chunk is not None,
        )
        writer.start()
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        channels = {topic: writer.register_channel(topic, 'cdr', schema) for topic in TOPICS}
        for topic, log_time, data in messages:
            writer.add_message(channels[topic], log_time, data, log_time // 2)
        writer.finish()


def told(
    bag: Bag, together: set[str], start: int | None = None, end: int | None = None
) -> list[BagMessage]:
    found: list[BagMessage] = []
    for item in bag.stretches(set(TOPICS), together, start=start, end=end):
        if isinstance(item, Stretch):
            assert item.topic in together
            assert len(item.data)
            found += item.messages()
        else:
            found.append(item)
    return found


@st.composite
def recordings(draw: st.DrawFn) -> list[Written]:
    """Runs of messages of one topic and size, the order of their times disturbed."""
    messages: list[Written] = []
    for _ in range(draw(st.integers(1, 5))):
        topic, size = draw(st.sampled_from(TOPICS)), draw(st.integers(0, 3))
        for _ in range(draw(st.sampled_from((1, 2, 11, 12, 13, 40)))):
            messages.append((topic, 0, bytes([0, len(messages), 7])[:size]))
    shift = draw(st.sampled_from((0, 1, 30)))
    late = [k + draw(st.integers(-shift, shift)) if shift else k for k in range(len(messages))]
    # No two of a topic at one time: which is first would be the file's business.
    order = sorted(range(len(late)), key=late.__getitem__)
    scale = draw(st.sampled_from((1, 10**9)))
    times = {k: scale * (100 + place) for place, k in enumerate(order)}
    return [(topic, times[k], data) for k, (topic, _, data) in enumerate(messages)]


@settings(max_examples=60, deadline=None)
@given(
    messages=recordings(),
    chunk=st.sampled_from((None, 60, 700, 1 << 20)),
    together=st.sets(st.sampled_from(TOPICS)),
    cut=st.tuples(*[st.one_of(st.none(), st.integers(-5, 300))] * 2),
)
def test_stretches_hold_what_the_mcap_library_reads(
    messages: list[Written],
    chunk: int | None,
    together: set[str],
    cut: tuple[int | None, int | None],
) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder, 'some.mcap')
        write(path, messages, chunk=chunk)
        bag = open_bag(path)
        if chunk is None:
            theirs = sorted((log_time, topic, data) for topic, log_time, data in messages)
        else:
            with path.open('rb') as file:
                read = make_reader(file).iter_messages()
                theirs = [(m.log_time, c.topic, m.data) for _, c, m in read]
        found = told(bag, together)
        assert [(m.log_time, m.topic, m.data) for m in found] == theirs
        assert all(m.publish_time == m.log_time // 2 for m in found)
        assert found == list(bag.messages())
        start, end = cut
        assert told(bag, together, start, end) == [
            m
            for m in found
            if (start is None or m.log_time >= start) and (end is None or m.log_time <= end)
        ]


def test_long_runs_come_in_stretches(tmp_path: Path) -> None:
    run = [('/a', 1000 + k, b'\0' + bytes([k % 256])) for k in range(3000)]
    write(tmp_path / 'one.mcap', [*run, ('/b', 5000, b'\0')], chunk=20_000)
    bag = open_bag(tmp_path / 'one.mcap')
    items = list(bag.stretches(set(TOPICS), {'/a'}))
    assert sum(isinstance(item, Stretch) for item in items) < 40
    assert sum(isinstance(item, BagMessage) for item in items) < 50
    assert not any(isinstance(item, Stretch) for item in bag.stretches(set(TOPICS), {'/b'}))


@pytest.mark.parametrize('apart', [1, 0, -20])
def test_files_that_overlap_in_time_are_merged(tmp_path: Path, apart: int) -> None:
    first = [('/a', 100 + k, b'\0\1') for k in range(50)]
    second = [('/b', 149 + apart + k, b'\0\2') for k in range(50)]
    # The later one has the name that comes first.
    write(tmp_path / '0.mcap', second, chunk=1 << 20)
    write(tmp_path / '1.mcap', first, chunk=1 << 20)
    bag = open_bag(tmp_path)
    items = list(bag.stretches(set(TOPICS), set(TOPICS)))
    assert any(isinstance(item, Stretch) for item in items) == (apart > 0)
    found = told(bag, set(TOPICS))
    assert found == list(bag.messages())
    assert len(found) == 100
    assert all(one.log_time <= other.log_time for one, other in pairwise(found))


def test_messages_of_one_time_come_by_topic(tmp_path: Path) -> None:
    run = [(topic, 100 + k, b'\0') for k in range(30) for topic in ('/c', '/a', '/b')]
    write(tmp_path / 'one.mcap', run, chunk=400)
    found = told(open_bag(tmp_path / 'one.mcap'), {'/a', '/b', '/c'})
    assert [(m.log_time, m.topic) for m in found] == sorted((t, topic) for topic, t, _ in run)


def test_packed_messages_are_unpacked_one_by_one(tmp_path: Path) -> None:
    packed = zstandard.ZstdCompressor().compress(b'\0\1\0\0text')
    run = [('/a', 100 + k, packed) for k in range(30)]
    write(tmp_path / 'one.mcap', run, chunk=1 << 20)
    items = list(open_bag(tmp_path / 'one.mcap').stretches({'/a'}, {'/a'}))
    assert [item.data for item in items if isinstance(item, BagMessage)] == 30 * [b'\0\1\0\0text']
