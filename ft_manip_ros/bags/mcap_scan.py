"""Reading an MCAP file record by record, whatever state it is in."""

from __future__ import annotations

import re
import struct
from bisect import bisect_left
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from ft_manip_ros.bags import mcap_records as mr
from ft_manip_ros.bags.mcap_records import Channel, RecordedMessage, RecordError, Schema
from ft_manip_ros.bags.source import Damage
from ft_manip_ros.core.errors import InputError

_HEAD = struct.Struct('<BQ')
# A chunk's opcode and the eight bytes of a length below 4 GiB.
_CHUNK_START = re.compile(rb'\x06[\x00-\xff]{4}\x00{4}')
_RESYNC_BLOCK = 1 << 24


@dataclass(frozen=True)
class _Chunk:
    offset: int
    length: int
    start: int
    count: int


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

    def messages(self, wanted: Collection[str] | None = None) -> Iterator[RecordedMessage]:
        """Yield the readable messages by log time, then topic, then place in the file.

        Parameters
        ----------
        wanted
            Only of these topics; of all if None.
        """
        topics = {
            channel.id: channel.topic
            for channel in self.channels.values()
            if wanted is None or channel.topic in wanted
        }
        # Sorted; the third entry keeps the order in the file.
        held: list[tuple[int, str, int, RecordedMessage]] = [
            (message.log_time, topics[message.channel_id], order, message)
            for order, message in enumerate(self._loose)
            if message.channel_id in topics
        ]
        held.sort()
        order = len(self._loose)
        with self.path.open('rb') as file:
            for chunk in sorted(self._chunks, key=lambda c: (c.start, c.offset)):
                before = bisect_left(held, (chunk.start,))
                yield from [entry[3] for entry in held[:before]]
                del held[:before]
                file.seek(chunk.offset)
                for message in self._chunk_messages(file.read(chunk.length), chunk.count, topics):
                    held.append((message.log_time, topics[message.channel_id], order, message))
                    order += 1
                held.sort()
        yield from [entry[3] for entry in held]

    def _chunk_messages(
        self, body: bytes, count: int, topics: Mapping[int, str]
    ) -> Iterator[RecordedMessage]:
        """Those of the first ``count`` messages of a chunk (what opening it found usable)."""
        for opcode, record in mr.split_records(mr.chunk_records(body)):
            if count == 0:
                return
            if opcode == mr.MESSAGE:
                count -= 1
                if record[0] | record[1] << 8 in topics:
                    yield mr.parse_message(record)

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
            head = file.read(_HEAD.size)
            if len(head) < _HEAD.size:
                self._note(at, 'the file ends inside a record head')
                return
            opcode, length = _HEAD.unpack(head)
            body_at = at + _HEAD.size
            if opcode == mr.DATA_END:
                self._check_end(file, at)
                return
            if not 0 < opcode < 0x80 or length > self._size - body_at:
                self._note(at, 'the file ends inside a record, or the record is damaged')
                at = self._resync(file, at + 1)
                continue
            if not self._record(file, opcode, at, length):
                at = self._resync(file, at + 1)
                continue
            at = body_at + length
        self._note(self._size, 'the file was not closed: its index is missing')

    def _record(self, file: BinaryIO, opcode: int, at: int, length: int) -> bool:
        """Take in one record; False where even its length is not to be trusted."""
        try:
            if opcode == mr.CHUNK:
                self._chunk(file.read(length), at)
            elif opcode in (mr.SCHEMA, mr.CHANNEL, mr.MESSAGE):
                self._take(opcode, file.read(length))
            elif opcode == mr.METADATA:
                name, values = mr.parse_metadata(file.read(length))
                self.metadata.setdefault(name, {}).update(values)
            elif opcode == mr.ATTACHMENT:
                name, media_type, content = mr.parse_attachment(file.read(length))
                self.attachments[name] = (media_type, content)
        except RecordError as error:
            self._note(at, str(error))
            following = at + _HEAD.size + length
            return following == self._size or self._plausible(file, following)
        return True

    def _plausible(self, file: BinaryIO, at: int) -> bool:
        """True if a record can begin at this offset."""
        file.seek(at)
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return False
        opcode, length = _HEAD.unpack(head)
        return 0 < opcode <= mr.LAST_OPCODE and length <= self._size - at - _HEAD.size

    def _chunk(self, body: bytes, at: int) -> None:
        records = mr.chunk_records(body)
        times = []
        try:
            for opcode, record in mr.split_records(records):
                log_time = self._take(opcode, record, keep=False)
                if log_time is not None:
                    times.append(log_time)
        finally:
            if times:
                self._chunks.append(_Chunk(at + _HEAD.size, len(body), min(times), len(times)))

    def _take(self, opcode: int, record: bytes, *, keep: bool = True) -> int | None:
        """Take in a schema, channel or message; return the log time of a usable message."""
        if opcode == mr.SCHEMA:
            schema = mr.parse_schema(record)
            if self.schemas.setdefault(schema.id, schema) != schema:
                raise RecordError(f'schema {schema.id} ({schema.name}) comes twice, differing')
        elif opcode == mr.CHANNEL:
            channel = mr.parse_channel(record)
            if self.channels.setdefault(channel.id, channel) != channel:
                raise RecordError(f'channel {channel.id} ({channel.topic}) comes twice, differing')
        elif opcode == mr.MESSAGE:
            channel_id, log_time = mr.message_head(record)
            if channel_id not in self.channels:
                raise RecordError(f'a message names the unknown channel {channel_id}')
            first = not self.counts
            self.counts[channel_id] += 1
            self.start = log_time if first or log_time < self.start else self.start
            self.end = max(self.end, log_time)
            if keep:
                self._loose.append(mr.parse_message(record))
            return log_time
        return None

    def _resync(self, file: BinaryIO, at: int) -> int:
        """Offset of the next chunk that verifies, or the file's size."""
        while at < self._size:
            file.seek(at)
            block = file.read(_RESYNC_BLOCK)
            for match in _CHUNK_START.finditer(block):
                start = at + match.start()
                if self._is_whole_chunk(file, start):
                    return start
            if len(block) < _HEAD.size:
                break
            at += max(len(block) - _HEAD.size + 1, 1)
        return self._size

    def _is_whole_chunk(self, file: BinaryIO, at: int) -> bool:
        file.seek(at)
        _, length = _HEAD.unpack(file.read(_HEAD.size))
        if length > self._size - at - _HEAD.size:
            return False
        try:
            # Cheap refusals first: damage must not cost a decompression per byte.
            mr.check_chunk_head(file.read(min(length, 64)))
            file.seek(at + _HEAD.size)
            mr.chunk_records(file.read(length))
        except RecordError:
            return False
        return True

    def _check_end(self, file: BinaryIO, at: int) -> None:
        file.seek(max(self._size - len(mr.MAGIC), 0))
        self.finished = file.read() == mr.MAGIC
        if not self.finished:
            self._note(at, 'the index at the end of the file is cut short')

    def _note(self, offset: int, problem: str) -> None:
        self.damage.append(Damage(self.path.name, offset, problem))
