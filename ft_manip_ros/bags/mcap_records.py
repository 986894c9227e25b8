"""MCAP records from untrusted bytes: bounded memory, checked lengths and checksums."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import NamedTuple

import lz4.frame
import zstandard

MAGIC = b'\x89MCAP0\r\n'
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06
ATTACHMENT, METADATA, DATA_END = 0x09, 0x0C, 0x0F
LAST_OPCODE = 0x0F

# A chunk is a few MiB in practice; a larger claim is damage, and believing it costs memory.
LARGEST_CHUNK = 1 << 28
COMPRESSIONS = ('', 'zstd', 'lz4')

MESSAGE_HEAD = struct.Struct('<HIQQ')
RECORD_HEAD = struct.Struct('<BQ')
_CHUNK_HEAD = struct.Struct('<QQQI')


class RecordError(ValueError):
    """Bytes that are not what they claim to be."""


@dataclass(frozen=True)
class Schema:
    """A schema record: how messages of one type are decoded."""

    id: int
    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True)
class Channel:
    """A channel record: one topic with one type."""

    id: int
    schema_id: int
    topic: str
    message_encoding: str
    metadata: dict[str, str]


class RecordedMessage(NamedTuple):
    """A message record; times in ns."""

    channel_id: int
    log_time: int
    publish_time: int
    data: bytes


class Cursor:
    """Reads fields from a record's bytes and refuses to go beyond them."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def take(self, length: int) -> bytes:
        """Return the next ``length`` bytes."""
        end = self.at + length
        if end > len(self.data):
            raise RecordError(f'a field of {length} bytes leaves its record')
        piece = self.data[self.at : end]
        self.at = end
        return piece

    def number(self, code: str) -> int:
        """Return a little-endian integer of a `struct` code."""
        return int(struct.unpack('<' + code, self.take(struct.calcsize('<' + code)))[0])

    def text(self) -> str:
        """Return a length-prefixed UTF-8 string."""
        raw = self.take(self.number('I'))
        try:
            return raw.decode('utf-8')
        except UnicodeDecodeError:
            raise RecordError('a text field is not UTF-8') from None

    def mapping(self) -> dict[str, str]:
        """Return a length-prefixed map of strings."""
        inner = Cursor(self.take(self.number('I')))
        found = {}
        while inner.at < len(inner.data):
            key = inner.text()
            found[key] = inner.text()
        return found


def parse_schema(body: bytes) -> Schema:
    """Parse a schema record."""
    c = Cursor(body)
    return Schema(c.number('H'), c.text(), c.text(), c.take(c.number('I')))


def parse_channel(body: bytes) -> Channel:
    """Parse a channel record."""
    c = Cursor(body)
    return Channel(c.number('H'), c.number('H'), c.text(), c.text(), c.mapping())


def parse_metadata(body: bytes) -> tuple[str, dict[str, str]]:
    """Parse a metadata record: name and values."""
    c = Cursor(body)
    return c.text(), c.mapping()


def parse_attachment(body: bytes) -> tuple[str, str, bytes]:
    """Parse an attachment: name, media type, content."""
    c = Cursor(body)
    c.take(16)
    name, media_type = c.text(), c.text()
    content = c.take(c.number('Q'))
    end = c.at
    crc = c.number('I')
    if crc and zlib.crc32(body[:end]) != crc:
        raise RecordError(f'attachment {name!r} does not match its checksum')
    return name, media_type, content


def parse_message(body: bytes) -> RecordedMessage:
    """Parse a message record."""
    if len(body) < MESSAGE_HEAD.size:
        raise RecordError('a message record is too short')
    channel, _, log_time, publish_time = MESSAGE_HEAD.unpack_from(body)
    return RecordedMessage(channel, log_time, publish_time, body[MESSAGE_HEAD.size :])


def check_chunk_head(body: bytes) -> None:
    """Raise `RecordError` unless the first bytes can be those of a chunk of this length."""
    if len(body) < _CHUNK_HEAD.size + 4:
        raise RecordError('a chunk is too short')
    _, _, size, _ = _CHUNK_HEAD.unpack_from(body)
    if size > LARGEST_CHUNK:
        raise RecordError(f'a chunk claims {size} bytes, more than {LARGEST_CHUNK}')


def chunk_records(body: bytes, *, verified: bool = False) -> bytes:
    """Decompress a chunk and verify its size and, unless that was done before, its checksum."""
    check_chunk_head(body)
    c = Cursor(body)
    _, _, size, crc = _CHUNK_HEAD.unpack(c.take(_CHUNK_HEAD.size))
    compression = c.text()
    packed = c.take(c.number('Q'))
    records = _decompress(compression, packed, size)
    if len(records) != size:
        raise RecordError(f'a chunk holds {len(records)} bytes instead of {size}')
    if crc and not verified and zlib.crc32(records) != crc:
        raise RecordError('a chunk does not match its checksum')
    return records


def _decompress(compression: str, packed: bytes, size: int) -> bytes:
    try:
        if compression == '':
            return packed
        if compression == 'zstd':
            # The frame's own claim decides how much the library allocates: check it first.
            claimed = zstandard.frame_content_size(packed)
            if claimed > size:
                raise RecordError(f'a chunk unpacks to {claimed} bytes instead of {size}')
            return zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
        if compression == 'lz4':
            return lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size)
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise RecordError(f'a chunk does not unpack ({error})') from None
    raise RecordError(f'a chunk uses compression {compression!r}; known are zstd, lz4 and none')
