"""One MCAP file being written: only whole records reach the disk, and it knows how many."""

from __future__ import annotations

import os
import time
from pathlib import Path

from mcap.writer import CompressionType, Writer

from ft_manip_ros.bags.definitions import MessageDefinition
from ft_manip_ros.core.errors import InputError

COMPRESSIONS = {
    'zstd': CompressionType.ZSTD,
    'lz4': CompressionType.LZ4,
    'none': CompressionType.NONE,
}
PROFILE = 'ros2'
LIBRARY = 'ft_manip_ros'


class WholeRecordFile:
    """Unbuffered file that takes back a write that did not fit.

    The MCAP writer hands over whole records. Where the disk takes only part of one (full disk,
    quota), the file is cut back to the last whole record, so what is there stays readable.
    """

    def __init__(self, path: Path) -> None:
        self._file = open(path, 'xb', buffering=0)  # noqa: SIM115 (closed by close)
        self.size = 0

    def write(self, data: bytes) -> int:
        """Append ``data`` whole, or raise OSError and leave the file as it was."""
        view = memoryview(data)
        try:
            done = 0
            while done < len(view):
                done += self._file.write(view[done:]) or 0
        except OSError:
            try:
                self._file.truncate(self.size)
                self._file.seek(self.size)
            except OSError:
                pass  # a disk that refuses even this: readers skip the partial record
            raise
        self.size += len(view)
        return len(view)

    def tell(self) -> int:
        """Bytes written."""
        return self.size

    def flush(self) -> None:
        """Nothing is buffered here: every write has reached the operating system."""

    def sync(self) -> None:
        """Have the operating system put everything on the disk."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class McapFile:
    """One MCAP file with profile ros2: channels, messages, metadata, attachments.

    Parameters
    ----------
    path
        File to create; it must not exist.
    compression
        'zstd', 'lz4' or 'none', of chunks.
    chunk_size
        Largest size of a chunk before compression, bytes.
    """

    def __init__(
        self, path: Path, *, compression: str = 'zstd', chunk_size: int = 1 << 20
    ) -> None:
        if compression not in COMPRESSIONS:
            raise InputError(
                'compression', f'is {compression!r}; valid are {", ".join(COMPRESSIONS)}'
            )
        self.path = path
        self._file = WholeRecordFile(path)
        self._writer = Writer(
            self._file,
            chunk_size=chunk_size,
            compression=COMPRESSIONS[compression],
        )
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._sequences: dict[int, int] = {}
        self._pending = 0
        self._writer.start(profile=PROFILE, library=LIBRARY)

    @property
    def written(self) -> int:
        """Bytes that have reached the operating system."""
        return self._file.size

    @property
    def size(self) -> int:
        """Bytes on disk plus those waiting for the next flush (before compression)."""
        return self._file.size + self._pending

    def add_channel(self, key: str, topic: str, definition: MessageDefinition, qos: str) -> None:
        """Register a channel under ``key`` once; ``qos`` is its offered_qos_profiles YAML."""
        if key in self._channels:
            return
        schema = self._schemas.get(definition.type_name)
        if schema is None:
            encoding = definition.encoding if definition.text else ''
            schema = self._writer.register_schema(
                definition.type_name, encoding, definition.text.encode()
            )
            self._schemas[definition.type_name] = schema
        self._channels[key] = self._writer.register_channel(
            topic,
            'cdr',
            schema,
            {'offered_qos_profiles': qos, 'topic_type_hash': definition.type_hash},
        )

    def add_message(self, key: str, data: bytes, log_time: int, publish_time: int) -> None:
        """Append one message (CDR bytes, times in ns) to the current chunk."""
        channel = self._channels[key]
        sequence = self._sequences.get(channel, 0)
        self._sequences[channel] = sequence + 1
        before = self._file.size
        self._pending += len(data) + 31
        self._writer.add_message(channel, log_time, data, publish_time, sequence & 0xFFFFFFFF)
        if self._file.size != before:
            self._pending = 0

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Append a metadata record."""
        self._writer.add_metadata(name, values)

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Append an attachment, stamped with the wall clock."""
        now = time.time_ns()
        self._writer.add_attachment(now, now, name, media_type, data)

    def flush(self, *, sync: bool = False) -> None:
        """Close the current chunk and hand it to the operating system (and the disk)."""
        self._writer.flush()
        self._pending = 0
        if sync:
            self._file.sync()

    def close(self) -> None:
        """Write the index and close; without it, a reader finds the file unfinished."""
        try:
            self._writer.finish()
        finally:
            self._file.close()

    def abandon(self) -> None:
        """Close without an index, after an error of the disk."""
        self._file.close()
