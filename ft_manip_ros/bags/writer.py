"""Writing a rosbag2-compatible bag: a folder of MCAP files and ``metadata.yaml``."""

from __future__ import annotations

import time
from pathlib import Path
from types import TracebackType

from ft_manip_ros.bags.definitions import MessageDefinition
from ft_manip_ros.bags.mcap_file import McapFile
from ft_manip_ros.bags.mcap_rewrite import rewrite_file
from ft_manip_ros.bags.qos import QosProfile, dump_profiles
from ft_manip_ros.bags.rosbag_metadata import BagMetadata, FileRecord, TopicRecord
from ft_manip_ros.bags.writer_settings import WriterSettings
from ft_manip_ros.core.errors import InputError


class BagWriter:
    """A bag being written.

    Not safe for use from several threads at once. Every file of the bag carries the provenance
    (metadata records and attachments), so that each can stand alone.

    Parameters
    ----------
    folder
        Folder to create; an existing one is never touched.
    settings
        Layout on disk.

    Raises
    ------
    InputError
        If the folder exists or cannot be created.
    """

    def __init__(self, folder: Path | str, settings: WriterSettings | None = None) -> None:
        self.folder = Path(folder)
        self.settings = settings or WriterSettings()
        try:
            self.folder.mkdir(parents=True)
        except FileExistsError:
            raise InputError(
                f'bag {self.folder}', 'exists already; it is not overwritten'
            ) from None
        except OSError as error:
            raise InputError(
                f'bag {self.folder}', f'cannot be created: {error.strerror}'
            ) from None
        self.metadata = BagMetadata()
        self.flushed = time.monotonic()
        self._topics: dict[str, tuple[TopicRecord, MessageDefinition, str]] = {}
        self._provenance: dict[str, dict[str, str]] = {}
        self._attachments: dict[str, tuple[str, bytes]] = {}
        self._file: McapFile | None = None
        self._record = FileRecord('')
        self._first_time: int | None = None
        # Messages of the chunk in progress: kept until the disk has taken them.
        self._pending: list[tuple[str, bytes, int, int]] = []
        self._broken: list[FileRecord] = []
        self._open_next()

    @property
    def message_count(self) -> int:
        """Messages that have reached the operating system, over all files."""
        return sum(record.count for record in self.metadata.files)

    @property
    def size(self) -> int:
        """Bytes of the current file."""
        return self._file.size if self._file else 0

    def add_topic(
        self,
        topic: str,
        definition: MessageDefinition,
        qos: tuple[QosProfile, ...] = (),
    ) -> str:
        """Register a topic and return the key under which to write its messages.

        A topic that comes again with another type gets a channel of its own.
        """
        key = f'{topic} {definition.type_name}'
        if key not in self._topics:
            record = TopicRecord(topic, definition.type_name, definition.type_hash, qos)
            self.metadata.topics.append(record)
            self._topics[key] = (record, definition, dump_profiles(qos))
        return key

    def write(self, key: str, data: bytes, log_time: int, publish_time: int | None = None) -> None:
        """Append one message: CDR bytes, reception time and, where known, sending time (ns).

        Raises
        ------
        OSError
            If the disk refuses; what was flushed before stays readable, and the next call tries
            a new file.
        """
        self._pending.append((key, data, log_time, publish_time or log_time))
        if self._file is None:
            self._open_next()
            return
        if self._split_is_due(log_time):
            message = self._pending.pop()
            self._finish_file()
            self._pending.append(message)
            self._open_next()
            return
        self._append(self._pending[-1])

    def _append(self, message: tuple[str, bytes, int, int]) -> None:
        key, data, log_time, publish_time = message
        assert self._file is not None
        topic, definition, qos = self._topics[key]
        written = self._file.written
        try:
            self._file.add_channel(key, topic.name, definition, qos)
            self._file.add_message(key, data, log_time, publish_time)
        except OSError:
            if self._file.written != written:
                self._commit()  # the chunk itself went in, only its index did not
            self._abandon()
            raise
        if self._first_time is None:
            self._first_time = log_time
        if self._file.written != written:
            self._commit()

    def _commit(self) -> None:
        """The disk has taken all pending messages: count them, forget them."""
        for key, _, log_time, _ in self._pending:
            self._topics[key][0].count += 1
            self._record.add(log_time)
        self._pending.clear()

    def add_provenance(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record, also into every later file and into ``metadata.yaml``."""
        self._provenance[name] = values
        for key, value in values.items():
            self.metadata.custom[f'{name}:{key}'] = value
        if self._file is not None:
            self._file.add_metadata(name, values)

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a file, also to every later file of the bag."""
        self._attachments[name] = (media_type, data)
        if self._file is not None:
            self._file.add_attachment(name, media_type, data)

    def tick(self) -> None:
        """Flush if the flush interval has passed; call this regularly.

        Raises
        ------
        OSError
            As `write`.
        """
        if time.monotonic() - self.flushed >= self.settings.flush_interval:
            self.flush()

    def flush(self) -> None:
        """Hand everything written so far to the operating system."""
        self.flushed = time.monotonic()
        if self._file is None:
            if self._pending:
                self._open_next()
            return
        written = self._file.written
        try:
            self._file.flush(sync=self.settings.sync)
        except OSError:
            if self._file.written != written:
                self._commit()
            self._abandon()
            raise
        self._commit()

    def close(self) -> None:
        """Finish the last file and write ``metadata.yaml``.

        Files that the disk refused to finish are repaired where it now has room.

        Raises
        ------
        OSError
            If the disk still refuses; files without an index are left for ``ftmanip bag recover``.
        """
        self._finish_file()
        for record in self._broken:
            rewrite_file(self.folder / record.name)
        self._broken.clear()
        self.metadata.write(self.folder)

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _split_is_due(self, log_time: int) -> bool:
        s = self.settings
        if self._first_time is None:
            return False
        return (0 < s.split_size <= self.size) or (
            0.0 < s.split_duration * 1e9 <= log_time - self._first_time
        )

    def _open_next(self) -> None:
        """Begin the next file with the provenance and what no earlier file could take."""
        name = f'{self.folder.name}_{len(self.metadata.files)}.mcap'
        path = self.folder / name
        try:
            opened = McapFile(
                path, compression=self.settings.compression, chunk_size=self.settings.chunk_size
            )
        except OSError:
            path.unlink(missing_ok=True)
            raise
        self._file = opened
        self._first_time = None
        self._record = FileRecord(name)
        self.metadata.files.append(self._record)
        try:
            for key, values in self._provenance.items():
                opened.add_metadata(key, values)
            for key, (media_type, data) in self._attachments.items():
                opened.add_attachment(key, media_type, data)
        except OSError:
            self._abandon()
            raise
        for message in list(self._pending):
            self._append(message)

    def _finish_file(self) -> None:
        self.flush()
        finished, self._file = self._file, None
        if finished is None:
            return
        try:
            # As rosbag2 does, so that a file alone still says what the folder says.
            finished.add_metadata('rosbag2', {'serialized_metadata': self.metadata.text()})
            finished.close()
        except OSError:
            self._broken.append(self._record)
            raise

    def _abandon(self) -> None:
        """Give up the current file after an error of the disk; its messages stay pending."""
        broken, self._file = self._file, None
        if broken is None:
            return
        broken.abandon()
        if self._record.count:
            self._broken.append(self._record)
        else:
            broken.path.unlink(missing_ok=True)
            self.metadata.files.remove(self._record)
