"""Reading bags: rosbag2 folders and single files, also unfinished or damaged ones."""

from __future__ import annotations

import heapq
import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

from ft_manip_ros.bags.compressed import SUFFIX, UnpackedFile, unpack_message
from ft_manip_ros.bags.decode import Decoder
from ft_manip_ros.bags.mcap_source import McapSource
from ft_manip_ros.bags.rosbag_metadata import FILE_NAME, read_file_names_and_custom
from ft_manip_ros.bags.source import BagMessage, Damage, Source, Stretch, TopicInfo
from ft_manip_ros.core.errors import InputError

# First byte of every serialized message; another one may be that of rosbag2's compression.
_PLAIN = b'\0'


@dataclass
class Bag:
    """An open bag, whoever recorded it.

    Attributes
    ----------
    sources
        Its storage files in order.
    provenance
        Values by record name: metadata records of the files and ``custom_data`` of the folder.
    attachments
        (media type, content) by name.
    notes
        What a reader should know: damage, missing metadata.yaml.
    """

    path: Path
    sources: list[Source]
    provenance: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, tuple[str, bytes]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    topics: dict[str, TopicInfo] = field(default_factory=dict)
    # Unpacked files, which are there as long as the bag is.
    unpacked: list[UnpackedFile] = field(default_factory=list, repr=False)

    def __post_init__(self) -> None:
        self._decoder = Decoder()
        for source in self.sources:
            for type_name, encoding, text in source.schemas():
                self._decoder.add_schema(type_name, encoding, text)
            for topic, info in source.topics().items():
                known = self.topics.setdefault(topic, TopicInfo(info.type_name))
                known.count += info.count
                known.type_hash = known.type_hash or info.type_hash
                known.qos = known.qos or info.qos
                known.readable = known.readable and info.readable
            self.attachments.update(source.attachments)
            for name, values in source.metadata.items():
                self.provenance.setdefault(name, {}).update(values)
            self.notes.extend(str(damage) for damage in source.damage)

    @property
    def message_count(self) -> int:
        """Readable messages."""
        return sum(info.count for info in self.topics.values())

    @property
    def start(self) -> int:
        """Log time of the first message, ns."""
        return min((s.start for s in self.sources if s.end), default=0)

    @property
    def end(self) -> int:
        """Log time of the last message, ns."""
        return max((s.end for s in self.sources), default=0)

    def messages(
        self,
        topics: Collection[str] | None = None,
        *,
        start: int | None = None,
        end: int | None = None,
    ) -> Iterator[BagMessage]:
        """Yield messages by log time, then topic, then place in the file.

        Parameters
        ----------
        topics
            Only these; all of them if None.
        start, end
            Only from ``start`` on and up to ``end``, log times in ns.
        """
        streams = [source.messages(topics) for source in self.sources]
        merged = (
            streams[0]
            if len(streams) == 1
            else heapq.merge(*streams, key=lambda m: (m.log_time, m.topic))
        )
        for message in merged:
            if end is not None and message.log_time > end:
                return
            if start is None or message.log_time >= start:
                yield _unpacked(message)

    def stretches(
        self,
        topics: Collection[str],
        together: Collection[str],
        *,
        start: int | None = None,
        end: int | None = None,
    ) -> Iterator[BagMessage | Stretch]:
        """As `messages`, in the same order; those of the topics ``together`` may come at once."""
        files = sorted(self.sources, key=lambda source: source.start)
        if any(one.end >= other.start for one, other in pairwise(files)):
            # Files that overlap in time: message by message.
            yield from self.messages(topics, start=start, end=end)
            return
        for item in chain.from_iterable(f.stretches(topics, together) for f in files):
            if isinstance(item, BagMessage):
                if end is not None and item.log_time > end:
                    return
                if start is None or item.log_time >= start:
                    yield _unpacked(item)
                continue
            piece = item.between(start, end)
            if piece.data[:, :1].any():
                yield from map(_unpacked, piece.messages())
            elif len(piece.data):
                yield piece

    def decode(self, message: BagMessage) -> Any:
        """Return the decoded message.

        Raises
        ------
        InputError
            If the bytes do not fit the type; the message names topic and log time.
        """
        try:
            return self._decoder.decode(message.type_name, message.data)
        except InputError as error:
            raise InputError(
                f'{self.path}: {message.topic} at {message.log_time} ns',
                f'{error.field}: {error.problem}',
            ) from None

    def decode_expected(self, message: BagMessage) -> Any:
        """As `decode`, of a message whose type is the one that `topics` names.

        Raises
        ------
        InputError
            As `decode`, and for a message of another type: topics may change theirs.
        """
        expected = self.topics[message.topic].type_name
        if message.type_name != expected:
            raise InputError(
                f'{self.path}: {message.topic} at {message.log_time} ns',
                f'type: is {message.type_name}, on a topic of {expected}',
            )
        return self.decode(message)

    def readable(self, topics: Collection[str]) -> Iterator[Any]:
        """Decoded messages of topics, without those that `decode_expected` refuses."""
        for message in self.messages(topics):
            try:
                yield self.decode_expected(message)
            except InputError:
                continue

    def schema_of(self, type_name: str) -> dict[str, Any]:
        """Fields of a type and of those it nests, by type name, as `Decoder.fields` has them.

        Raises
        ------
        InputError
            If the schema is unreadable or unknown.
        """
        return self._decoder.fields(type_name)


def _unpacked(message: BagMessage) -> BagMessage:
    if message.data[:1] == _PLAIN:
        return message
    return message._replace(data=unpack_message(message.data))


def open_bag(path: Path | str) -> Bag:
    """Open a rosbag2 folder or a single .mcap or .db3 file, also packed (.zstd).

    A folder around a single bag, such as a case of the library, is as good as the bag.

    Raises
    ------
    InputError
        If there is no bag; the message says what was looked for.
    """
    path = _bag_itself(Path(path))
    notes: list[str] = []
    custom: dict[str, str] = {}
    if path.is_file():
        files = [path]
    elif (path / FILE_NAME).is_file():
        try:
            names, custom, _ = read_file_names_and_custom(path / FILE_NAME)
            files = [path / Path(name).name for name in names]
        except InputError as error:
            notes.append(f'{error}; its storage files are read instead')
            files = _storage_files(path)
        missing = [file.name for file in files if not file.is_file()]
        if missing:
            notes.append(f'{FILE_NAME} names files that are missing: {", ".join(missing)}')
            files = [file for file in files if file.is_file()]
    else:
        notes.append(f'{FILE_NAME} is missing (the recorder was not closed in order)')
        files = _storage_files(path)
    if not files:
        raise InputError(f'bag {path}', _without_files(path))
    opened = [_open_storage(file) for file in files]
    bag = Bag(path, [source for source, _ in opened])
    bag.unpacked = [unpacked for _, unpacked in opened if unpacked is not None]
    bag.notes[:0] = notes
    for key, value in custom.items():
        name, _, entry = key.rpartition(':')
        bag.provenance.setdefault(name, {}).setdefault(entry, value)
    return bag


def _bag_itself(path: Path) -> Path:
    """Return the path, or the one bag in a folder that is none itself."""
    if not path.exists():
        raise InputError(f'bag {path}', 'does not exist')
    if path.is_dir() and not _is_bag(path):
        inside = _bags_in(path)
        if len(inside) == 1:
            return inside[0]
    return path


def _is_bag(folder: Path) -> bool:
    return (folder / FILE_NAME).is_file() or bool(_storage_files(folder))


def _bags_in(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.is_dir() and _is_bag(path))


def _without_files(folder: Path) -> str:
    problem = 'holds no .mcap or .db3 file'
    inside = [path.name for path in _bags_in(folder)]
    return f'{problem}; there are bags in it: {", ".join(inside)}' if inside else problem


def _storage_files(folder: Path) -> list[Path]:
    def natural(path: Path) -> list[int | str]:
        return [int(t) if t.isdigit() else t for t in re.split(r'(\d+)', path.name)]

    found = {
        path
        for path in folder.iterdir()
        if path.name[0] != '.' and _storage_suffix(path) in ('.mcap', '.db3')
    }
    # rosbag2 packs a file and then deletes it; killed between, it leaves both.
    return sorted(
        (p for p in found if p.suffix != SUFFIX or p.with_suffix('') not in found), key=natural
    )


def _storage_suffix(path: Path) -> str:
    """Suffix of a storage file, packed or not."""
    return Path(path.name.removesuffix(SUFFIX)).suffix


def _open_storage(path: Path) -> tuple[Source, UnpackedFile | None]:
    """Open a storage file, unpacked first where it is packed."""
    if path.suffix != SUFFIX:
        return _open_source(path), None
    unpacked = UnpackedFile(path)
    source = _open_source(unpacked.path)
    if unpacked.problem:
        source.damage.insert(0, Damage(path.name, 0, unpacked.problem))
    return source, unpacked


def _open_source(path: Path) -> Source:
    if path.suffix == '.mcap':
        return McapSource(path)
    if path.suffix == '.db3':
        # Loaded only here: rosbags takes a third of a second to import.
        from ft_manip_ros.bags.sqlite_source import SqliteSource

        return SqliteSource(path)
    raise InputError(f'bag file {path}', 'is neither .mcap nor .db3 (nor one of them in .zstd)')
