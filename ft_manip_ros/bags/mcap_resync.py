"""Finding the way back into a damaged MCAP file: where the next record or chunk begins."""

from __future__ import annotations

import re
from typing import BinaryIO

from ft_manip_ros.bags.mcap_records import (
    LAST_OPCODE,
    RECORD_HEAD,
    RecordError,
    check_chunk_head,
    chunk_records,
)

# A chunk's opcode and the eight bytes of a length below 4 GiB.
_CHUNK_START = re.compile(rb'\x06[\x00-\xff]{4}\x00{4}')
_BLOCK = 1 << 24


def begins_record(file: BinaryIO, at: int, size: int) -> bool:
    """Whether a record can begin at this offset of a file of ``size`` bytes."""
    file.seek(at)
    head = file.read(RECORD_HEAD.size)
    if len(head) < RECORD_HEAD.size:
        return False
    opcode, length = RECORD_HEAD.unpack(head)
    return 0 < opcode <= LAST_OPCODE and length <= size - at - RECORD_HEAD.size


def next_chunk(file: BinaryIO, at: int, size: int) -> int:
    """Offset, from ``at`` on, of the next chunk that verifies, or the file's size."""
    while at < size:
        file.seek(at)
        block = file.read(_BLOCK)
        for match in _CHUNK_START.finditer(block):
            start = at + match.start()
            if _is_whole_chunk(file, start, size):
                return start
        if len(block) < RECORD_HEAD.size:
            break
        at += max(len(block) - RECORD_HEAD.size + 1, 1)
    return size


def _is_whole_chunk(file: BinaryIO, at: int, size: int) -> bool:
    file.seek(at)
    _, length = RECORD_HEAD.unpack(file.read(RECORD_HEAD.size))
    if length > size - at - RECORD_HEAD.size:
        return False
    try:
        # Cheap refusals first: damage must not cost a decompression per byte.
        check_chunk_head(file.read(min(length, 64)))
        file.seek(at + RECORD_HEAD.size)
        chunk_records(file.read(length))
    except RecordError:
        return False
    return True
