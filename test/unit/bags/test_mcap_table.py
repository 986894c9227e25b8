"""What is found inside a chunk, and what is said where it is damaged."""

from __future__ import annotations

import io
import re

import pytest
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from ft_manip_ros.bags.mcap_records import CHANNEL, SCHEMA, parse_channel, parse_schema
from ft_manip_ros.bags.mcap_table import ChunkContent, chunk_content

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
    found = chunk_content(file[8:-8])
    first = file.index(bytes([SCHEMA]), 8 + 9)
    return file[first : 8 + int(found.table.rows['end'][COUNT - 1])]


def rows_of(content: ChunkContent) -> list[tuple[int, int, int, bytes]]:
    """Channel, times and bytes of each message."""
    (data,) = content.table.buffers
    return [
        (channel, log_time, publish_time, data[begin:end])
        for _, channel, log_time, publish_time, begin, end in content.table.rows.tolist()
    ]


def test_messages_are_those_that_the_mcap_library_finds(file: bytes, chunk: bytes) -> None:
    theirs = [r for r in StreamReader(io.BytesIO(file)).records if isinstance(r, Message)]
    ours = rows_of(chunk_content(chunk))
    assert ours == [(m.channel_id, m.log_time, m.publish_time, m.data) for m in theirs]
    assert len(ours) == COUNT


def test_definitions_are_handed_on_whole(file: bytes, chunk: bytes) -> None:
    read = [r for r in StreamReader(io.BytesIO(file)).records if isinstance(r, Schema | Channel)]
    schema, channel = chunk_content(chunk).definitions()
    assert schema[:2] == (0, SCHEMA)
    assert channel[:2] == (0, CHANNEL)
    assert parse_schema(schema[2]).data == b'string data'
    assert parse_channel(channel[2]).topic == '/words'
    assert {type(r) for r in read} == {Schema, Channel}


def test_definitions_know_how_many_messages_come_before(chunk: bytes) -> None:
    numbers = [before for before, *_ in chunk_content(chunk + chunk).definitions()]
    assert numbers == [0, 0, COUNT, COUNT]


def test_records_of_other_kinds_are_passed_over(chunk: bytes) -> None:
    strange = bytes([0x77]) + (3).to_bytes(8, 'little') + b'abc'
    content = chunk_content(strange + strange + chunk + strange)
    assert rows_of(content) == rows_of(chunk_content(chunk))
    assert content.problem is None
    assert len(list(content.definitions())) == 2


def test_wherever_a_chunk_is_cut_what_lies_before_is_found(chunk: bytes) -> None:
    whole = chunk_content(chunk)
    ends = whole.table.rows['end'].tolist()
    defined = [chunk.index(body) + len(body) for _, _, body in whole.definitions()]
    for size in range(len(chunk)):
        content = chunk_content(chunk[:size])
        before = sum(end <= size for end in ends)
        assert rows_of(content) == rows_of(whole)[:before]
        assert len(list(content.definitions())) == sum(end <= size for end in defined)
        if size in {0, *defined, *ends}:
            assert content.problem is None
        else:
            assert re.search('cut short|claims', str(content.problem))


@pytest.mark.parametrize('count', [1, 31, 32, 33, 64, 65, 200])
@pytest.mark.parametrize('spare', [b'', b'\5\0', bytes([SCHEMA]) + bytes(8)])
def test_many_alike_are_all_found(chunk: bytes, count: int, spare: bytes) -> None:
    last = chunk[int(chunk_content(chunk).table.rows['begin'][-1]) - 31 :]
    content = chunk_content(chunk + (count - 1) * last + spare)
    assert rows_of(content)[COUNT:] == (count - 1) * rows_of(chunk_content(last))
    assert (content.problem is None) == (spare != b'\5\0')
    assert len(list(content.definitions())) == 2 + (len(spare) > 2)


def test_a_message_without_room_for_its_head_is_refused(chunk: bytes) -> None:
    begin = int(chunk_content(chunk).table.rows['begin'][0]) - 31
    short = chunk[: begin + 1] + (10).to_bytes(8, 'little') + chunk[begin + 9 : begin + 19]
    content = chunk_content(short + bytes(40))
    assert 'too short' in str(content.problem)
    assert not len(content.table)


def test_an_empty_chunk_holds_nothing() -> None:
    content = chunk_content(b'')
    assert content.problem is None
    assert not len(content.table)
    assert not list(content.definitions())
