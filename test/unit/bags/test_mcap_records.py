"""Records inside a chunk: where they lie, and what is said of those that are damaged."""

from __future__ import annotations

import io

import pytest
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from ft_manip_ros.bags.mcap_records import CHANNEL, MESSAGE, SCHEMA, RecordError, record_places

COUNT = 20


@pytest.fixture(scope='module')
def file() -> bytes:
    """What the mcap library writes without chunks: the records that a chunk would hold."""
    target = io.BytesIO()
    writer = Writer(target, compression=CompressionType.NONE, use_chunking=False)
    writer.start()
    schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
    channel = writer.register_channel('/words', 'cdr', schema)
    for k in range(COUNT):
        # The first have no content at all: a head is all there is of them.
        writer.add_message(channel, 100 + k, b'x' * (k // 2), 200 + k)
    writer.finish()
    return target.getvalue()


@pytest.fixture(scope='module')
def chunk(file: bytes) -> bytes:
    """From the first schema to the last message."""
    places = [p for p in record_places(file[8:-8]) if p[0] in (SCHEMA, CHANNEL, MESSAGE)]
    messages = [end for opcode, _, end, *_ in places if opcode == MESSAGE]
    first = next(begin for opcode, begin, *_ in places if opcode == SCHEMA) - 9
    return file[8 + first : 8 + messages[COUNT - 1]]


def test_places_are_those_that_the_mcap_library_finds(file: bytes, chunk: bytes) -> None:
    theirs = [r for r in StreamReader(io.BytesIO(file)).records if isinstance(r, Message)]
    ours = [
        (channel, log_time, publish_time, chunk[begin:end])
        for opcode, begin, end, channel, log_time, publish_time in record_places(chunk)
        if opcode == MESSAGE
    ]
    assert ours == [(m.channel_id, m.log_time, m.publish_time, m.data) for m in theirs]
    assert len(ours) == COUNT


def test_definitions_are_handed_on_whole(file: bytes, chunk: bytes) -> None:
    read = [r for r in StreamReader(io.BytesIO(file)).records if isinstance(r, Schema | Channel)]
    found = [p for p in record_places(chunk) if p[0] != MESSAGE]
    assert [p[0] for p in found] == [SCHEMA, CHANNEL]
    assert b'ros2msg' in chunk[found[0][1] : found[0][2]]
    assert b'/words' in chunk[found[1][1] : found[1][2]]
    assert {type(r) for r in read} == {Schema, Channel}


def test_wherever_a_chunk_is_cut_what_lies_before_is_found(chunk: bytes) -> None:
    whole = list(record_places(chunk))
    for size in range(len(chunk)):
        before = [p for p in whole if p[2] <= size]
        found = []
        if size in {0, *(p[2] for p in whole)}:
            assert list(record_places(chunk[:size])) == before
            continue
        with pytest.raises(RecordError, match=r'cut short|claims'):
            found.extend(record_places(chunk[:size]))
        stream = record_places(chunk[:size])
        assert [next(stream) for _ in before] == before


def test_a_message_without_room_for_its_head_is_refused(chunk: bytes) -> None:
    begin = next(p[1] for p in record_places(chunk) if p[0] == MESSAGE) - 22 - 9
    short = chunk[: begin + 1] + (10).to_bytes(8, 'little') + chunk[begin + 9 : begin + 19]
    with pytest.raises(RecordError, match='too short'):
        list(record_places(short + bytes(40)))
