"""Messages of MCAP chunks as rows of a table: a minute of joint states has 60,000 of them.

Nothing is cut out or wrapped until someone wants it.
"""

from __future__ import annotations

from array import array
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.bags.mcap_records import (
    CHANNEL,
    MESSAGE,
    MESSAGE_HEAD,
    RECORD_HEAD,
    SCHEMA,
    RecordError,
)
from ft_manip_ros.bags.source import BagMessage, Stretch

# Head of a message record, byte by byte as in the file.
_HEAD = np.dtype(
    [
        ('opcode', 'u1'),
        ('length', '<u8'),
        ('channel', '<u2'),
        ('sequence', '<u4'),
        ('log_time', '<u8'),
        ('publish_time', '<u8'),
    ]
)
_ROW = np.dtype(
    [
        ('buffer', np.int64),
        ('channel', np.int64),
        ('log_time', np.uint64),
        ('publish_time', np.uint64),
        ('begin', np.int64),
        ('end', np.int64),
    ]
)
_LEAST = 12  # messages of a stretch; fewer are handed on sooner one by one
_LARGEST = 1024
_MANY = 32  # records alike after which more are looked at together


@dataclass(frozen=True)
class MessageTable:
    """K messages.

    Attributes
    ----------
    buffers
        Bytes in which they lie.
    rows : ndarray, shape (K,)
        Of each message: place of its buffer, channel id, times (ns), and where its bytes begin
        and end in the buffer.
    """

    buffers: tuple[bytes, ...]
    rows: NDArray[Any]

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, chosen: slice | NDArray[Any]) -> MessageTable:
        return MessageTable(self.buffers, self.rows[chosen])

    def of(self, channels: Collection[int]) -> MessageTable:
        """Those of these channels."""
        return self[np.isin(self.rows['channel'], list(channels))]

    def before(self, log_time: int) -> int:
        """How many of an ordered table lie before ``log_time``."""
        return int(np.searchsorted(self.rows['log_time'], np.uint64(log_time)))

    def followed_by(self, other: MessageTable) -> MessageTable:
        """These and then those; buffers without messages are let go."""
        if not len(self):
            return other
        used, mine = np.unique(self.rows['buffer'], return_inverse=True)
        rows = np.concatenate((self.rows, other.rows))
        rows['buffer'][: len(mine)] = mine
        rows['buffer'][len(mine) :] += len(used)
        return MessageTable((*(self.buffers[k] for k in used), *other.buffers), rows)

    def ordered(self, ranks: Mapping[int, int]) -> MessageTable:
        """By log time, then by rank of the channel; what is equal stays as it is."""
        times = self.rows['log_time']
        if (times[1:] > times[:-1]).all():
            return self
        known = np.zeros(max(ranks, default=0) + 1, dtype=np.int64)
        known[list(ranks)] = list(ranks.values())
        return self[np.lexsort((known[self.rows['channel']], times))]

    def messages(self, names: Mapping[int, tuple[str, str]]) -> Iterator[BagMessage]:
        """One by one, with topic and type of their channel."""
        for buffer, channel, log_time, publish_time, begin, end in self.rows.tolist():
            yield BagMessage(
                *names[channel], log_time, publish_time, self.buffers[buffer][begin:end]
            )

    def stretches(
        self, names: Mapping[int, tuple[str, str]], together: Collection[int]
    ) -> Iterator[BagMessage | Stretch]:
        """As `messages`, but those of the channels ``together`` in stretches where they can."""
        rows = self.rows
        size = rows['end'] - rows['begin']
        other = size[1:] != size[:-1]
        for key in ('channel', 'buffer'):
            other |= rows[key][1:] != rows[key][:-1]
        bounds = np.concatenate(([0], np.flatnonzero(other) + 1, [len(rows)]))
        done = 0
        for k in np.flatnonzero(np.diff(bounds) >= _LEAST):
            first, last = int(bounds[k]), int(bounds[k + 1])
            channel = int(rows['channel'][first])
            if channel not in together:
                continue
            yield from self[done:first].messages(names)
            for at in range(first, last, _LARGEST):
                yield self[at : min(at + _LARGEST, last)]._stretch(*names[channel])
            done = last
        yield from self[done:].messages(names)

    def _stretch(self, topic: str, type_name: str) -> Stretch:
        begin = self.rows['begin']
        first, size = int(begin[0]), int(self.rows['end'][0] - begin[0])
        whole = np.frombuffer(self.buffers[int(self.rows['buffer'][0])], dtype=np.uint8)
        steps = np.diff(begin)
        if len(steps) and steps[0] >= size and (steps == steps[0]).all():
            # One behind the other, as one driver's mostly are: seen where they lie.
            data = np.lib.stride_tricks.as_strided(
                whole[first:], (len(begin), size), (int(steps[0]), 1), writeable=False
            )
        else:
            data = whole[begin[:, None] + np.arange(size)]
        return Stretch(topic, type_name, self.rows['log_time'], self.rows['publish_time'], data)


def table_of(messages: Collection[tuple[int, int, int, bytes]]) -> MessageTable:
    """Messages outside chunks: channel id, log and publish time (ns), bytes."""
    rows = [
        (k, channel, log_time, publish_time, 0, len(data))
        for k, (channel, log_time, publish_time, data) in enumerate(messages)
    ]
    return MessageTable(tuple(m[3] for m in messages), np.array(rows, dtype=_ROW))


@dataclass(frozen=True)
class ChunkContent:
    """What lies in a chunk, up to where it is damaged.

    Attributes
    ----------
    table
        Its messages.
    problem
        What is wrong behind the last record found; None in a sound chunk.
    """

    table: MessageTable
    problem: RecordError | None
    _defining: NDArray[np.int64]

    def definitions(self) -> Iterator[tuple[int, int, bytes]]:
        """Of each schema or channel: how many messages lie before it, its opcode, its bytes."""
        (data,) = self.table.buffers
        before = np.searchsorted(self.table.rows['begin'], self._defining)
        for k, at in zip(before.tolist(), self._defining.tolist(), strict=True):
            opcode, length = RECORD_HEAD.unpack_from(data, at)
            begin = at + RECORD_HEAD.size
            yield k, opcode, data[begin : begin + length]


def chunk_content(data: bytes) -> ChunkContent:
    """Find the records of a chunk's unpacked bytes."""
    found, problem = _places(data)
    places = np.frombuffer(found, dtype=np.int64)
    whole = np.frombuffer(data, dtype=np.uint8)
    is_message = whole[places] == MESSAGE
    messages = places[is_message]
    rows = np.zeros(len(messages), dtype=_ROW)
    for at in range(0, len(messages), _LARGEST):
        some = slice(at, at + _LARGEST)
        heads = whole[messages[some, None] + np.arange(_HEAD.itemsize)].view(_HEAD)[:, 0]
        for key in ('channel', 'log_time', 'publish_time'):
            rows[key][some] = heads[key]
        rows['end'][some] = heads['length']
    rows['begin'] = messages + _HEAD.itemsize
    rows['end'] += messages + RECORD_HEAD.size
    return ChunkContent(MessageTable((data,), rows), problem, places[~is_message])


def _places(data: bytes) -> tuple[array[int], RecordError | None]:
    """Where messages, schemas and channels begin, and what is wrong behind the last record."""
    places = array('q')
    at, size = 0, len(data)
    while at < size:
        if at + RECORD_HEAD.size > size:
            return places, RecordError('a record inside a chunk is cut short')
        opcode, length = RECORD_HEAD.unpack_from(data, at)
        step = RECORD_HEAD.size + length
        if at + step > size:
            left = size - at - RECORD_HEAD.size
            return places, RecordError(f'a record inside a chunk claims {length} of {left} bytes')
        if opcode == MESSAGE and length < MESSAGE_HEAD.size:
            return places, RecordError('a message record is too short')
        if opcode not in (MESSAGE, SCHEMA, CHANNEL):
            at += step
            continue
        # Those that follow are mostly alike.
        head = data[at : at + RECORD_HEAD.size]
        count = _alike(data, at, head, step)
        places.extend(range(at, at + count * step, step))
        at += count * step
    return places, None


def _alike(data: bytes, at: int, head: bytes, step: int) -> int:
    """How many records with this head follow one another from ``at`` on, ``step`` bytes each."""
    count, most = 1, (len(data) - at) // step
    while count < most and data.startswith(head, at + count * step):
        count += 1
        if count < _MANY:
            continue
        # Twice as many at each go: little is looked at in vain where they end soon.
        ahead = min(count, most - count)
        begin = at + count * step
        rows = np.frombuffer(data, np.uint8, ahead * step, begin).reshape(ahead, step)
        same = (rows[:, : len(head)] == np.frombuffer(head, np.uint8)).all(axis=1)
        if not same.all():
            return count + int(same.argmin())
        count += ahead
    return count
