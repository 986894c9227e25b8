"""Reading an MCAP file record by record, whatever state it is in."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ft_manip_ros.bags import mcap_records as mr
from ft_manip_ros.bags.mcap_records import Channel, RecordedMessage, RecordError, Schema
from ft_manip_ros.bags.mcap_resync import begins_record, next_chunk
from ft_manip_ros.bags.mcap_table import ChunkContent, MessageTable, chunk_content, table_of
from ft_manip_ros.bags.source import BagMessage, Damage, Stretch
from ft_manip_ros.core.errors import InputError


@dataclass(frozen=True)
class _Chunk:
    offset: int
    length: int
    start: int
    count: int
    channels: frozenset[int]


class McapScan:
    """An MCAP file, complete or not, read without trusting its index.

    Every chunk is unpacked and verified once on opening; what does not verify is left out and
    listed in ``damage``. Messages come in order of log time, memory bounded by the chunks that
    overlap in time.

    Attributes
    ----------
    schemas, channels
        By id.
    metadata, attachments
        Metadata values by record name; (media type, content) by attachment name.
    counts
        Readable messages by channel id.
    damage
        What could not be read.
    finished
        True if the file was closed in order (index and end mark are there).
    start, end
        First and last log time (ns); 0 in an empty file.

    Raises
    ------
    InputError
        If the file is missing, unreadable or no MCAP file at all.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, tuple[str, bytes]] = {}
        self.counts: Counter[int] = Counter()
        self.damage: list[Damage] = []
        self.finished = False
        self.start = 0
        self.end = 0
        self._chunks: list[_Chunk] = []
        self._loose: list[RecordedMessage] = []
        try:
            self._size = path.stat().st_size
            with path.open('rb') as file:
                self._scan(file)
        except OSError as error:
            raise InputError(f'bag file {path}', f'cannot be read: {error.strerror}') from None

    def type_name(self, schema_id: int) -> str:
        """Name of a schema's type; empty if there is no such schema."""
        schema = self.schemas.get(schema_id)
        return schema.name if schema else ''

    def messages(self, wanted: Collection[str] | None = None) -> Iterator[BagMessage]:
        """Give the readable messages by log time, then topic, then place in the file.

        Parameters
        ----------
        wanted
            Only of these topics; of all if None.
        """
        return self.messages_of(self._names(wanted))

    def messages_of(self, names: Mapping[int, tuple[str, str]]) -> Iterator[BagMessage]:
        """As `messages`, of these channels, with ``names`` for topic and type of each."""
        for table in self._tables(names):
            yield from table.messages(names)

    def stretches(
        self, wanted: Collection[str], together: Collection[str]
    ) -> Iterator[BagMessage | Stretch]:
        """As `messages`, those of the topics ``together`` in stretches where they can."""
        names = self._names(wanted)
        channels = {channel for channel, (topic, _) in names.items() if topic in together}
        for table in self._tables(names):
            yield from table.stretches(names, channels)

    def _names(self, wanted: Collection[str] | None) -> dict[int, tuple[str, str]]:
        """Topic and type of the channels of these topics, by channel id."""
        return {
            channel.id: (channel.topic, self.type_name(channel.schema_id))
            for channel in self.channels.values()
            if wanted is None or channel.topic in wanted
        }

    def _tables(self, names: Mapping[int, tuple[str, str]]) -> Iterator[MessageTable]:
        """The readable messages of these channels in their order, about a chunk at a time."""
        topics = sorted({topic for topic, _ in names.values()})
        ranks = {channel: topics.index(topic) for channel, (topic, _) in names.items()}
        held = table_of(self._loose).of(names).ordered(ranks)
        with self.path.open('rb') as file:
            for chunk in sorted(self._chunks, key=lambda c: (c.start, c.offset)):
                if chunk.channels.isdisjoint(names):
                    continue
                before = held.before(chunk.start)
                yield held[:before]
                file.seek(chunk.offset)
                body = file.read(chunk.length)
                content = chunk_content(mr.chunk_records(body, verified=True))
                # Only what opening it found usable.
                found = content.table[: chunk.count].of(names)
                held = held[before:].followed_by(found).ordered(ranks)
        yield held

    def _scan(self, file: BinaryIO) -> None:
        mark = file.read(len(mr.MAGIC))
        if len(mark) < len(mr.MAGIC) and mr.MAGIC.startswith(mark):
            # A recorder that is killed just when it begins a file leaves it so.
            self._note(0, 'the file was begun and nothing was written to it')
            return
        if mark != mr.MAGIC:
            raise InputError(f'bag file {self.path}', 'is no MCAP file (it lacks the MCAP mark)')
        at = len(mr.MAGIC)
        while at < self._size:
            file.seek(at)
            head = file.read(mr.RECORD_HEAD.size)
            if len(head) < mr.RECORD_HEAD.size:
                self._note(at, 'the file ends inside a record head')
                return
            opcode, length = mr.RECORD_HEAD.unpack(head)
            body_at = at + mr.RECORD_HEAD.size
            if opcode == mr.DATA_END:
                self._check_end(file, at)
                return
            if not 0 < opcode < 0x80 or length > self._size - body_at:
                self._note(at, 'the file ends inside a record, or the record is damaged')
                at = next_chunk(file, at + 1, self._size)
                continue
            if not self._record(file, opcode, at, length):
                at = next_chunk(file, at + 1, self._size)
                continue
            at = body_at + length
        self._note(self._size, 'the file was not closed: its index is missing')

    def _record(self, file: BinaryIO, opcode: int, at: int, length: int) -> bool:
        """Take in one record; False where even its length is not to be trusted."""
        try:
            if opcode == mr.CHUNK:
                self._chunk(file.read(length), at)
            elif opcode in (mr.SCHEMA, mr.CHANNEL):
                self._define(opcode, file.read(length))
            elif opcode == mr.MESSAGE:
                self._message(file.read(length))
            elif opcode == mr.METADATA:
                name, values = mr.parse_metadata(file.read(length))
                self.metadata.setdefault(name, {}).update(values)
            elif opcode == mr.ATTACHMENT:
                name, media_type, content = mr.parse_attachment(file.read(length))
                self.attachments[name] = (media_type, content)
        except RecordError as error:
            self._note(at, str(error))
            following = at + mr.RECORD_HEAD.size + length
            return following == self._size or begins_record(file, following, self._size)
        return True

    def _chunk(self, body: bytes, at: int) -> None:
        content = chunk_content(mr.chunk_records(body))
        usable, problem = self._usable(content)
        if usable:
            rows = content.table.rows[:usable]
            start, end = int(rows['log_time'].min()), int(rows['log_time'].max())
            ids, numbers = np.unique(rows['channel'], return_counts=True)
            counts = dict(zip(ids.tolist(), numbers.tolist(), strict=True))
            place = at + mr.RECORD_HEAD.size
            self._chunks.append(_Chunk(place, len(body), start, usable, frozenset(counts)))
            self._count(counts, start, end)
        if problem is not None:
            raise problem

    def _usable(self, content: ChunkContent) -> tuple[int, RecordError | None]:
        """How many messages of a chunk can be used, and what is wrong behind the last of them.

        What the chunk defines is taken in on the way: messages come after their channel.
        """
        channels = content.table.rows['channel']
        done = 0
        for before, opcode, record in (*content.definitions(), (len(channels), 0, b'')):
            known = np.isin(channels[done:before], list(self.channels))
            if not known.all():
                done += int(known.argmin())
                return done, _unknown(int(channels[done]))
            done = before
            try:
                self._define(opcode, record)
            except RecordError as error:
                return done, error
        return done, content.problem

    def _define(self, opcode: int, record: bytes) -> None:
        """Take in a schema or channel."""
        if opcode == mr.SCHEMA:
            schema = mr.parse_schema(record)
            if self.schemas.setdefault(schema.id, schema) != schema:
                raise RecordError(f'schema {schema.id} ({schema.name}) comes twice, differing')
        elif opcode == mr.CHANNEL:
            channel = mr.parse_channel(record)
            if self.channels.setdefault(channel.id, channel) != channel:
                raise RecordError(f'channel {channel.id} ({channel.topic}) comes twice, differing')

    def _message(self, record: bytes) -> None:
        """Take in a message outside the chunks."""
        message = mr.parse_message(record)
        if message.channel_id not in self.channels:
            raise _unknown(message.channel_id)
        self._loose.append(message)
        self._count({message.channel_id: 1}, message.log_time, message.log_time)

    def _count(self, counts: Mapping[int, int], first: int, last: int) -> None:
        self.start = min(self.start, first) if self.counts else first
        self.end = max(self.end, last)
        self.counts.update(counts)

    def _check_end(self, file: BinaryIO, at: int) -> None:
        file.seek(max(self._size - len(mr.MAGIC), 0))
        self.finished = file.read() == mr.MAGIC
        if not self.finished:
            self._note(at, 'the index at the end of the file is cut short')

    def _note(self, offset: int, problem: str) -> None:
        self.damage.append(Damage(self.path.name, offset, problem))


def _unknown(channel_id: int) -> RecordError:
    return RecordError(f'a message names the unknown channel {channel_id}')
