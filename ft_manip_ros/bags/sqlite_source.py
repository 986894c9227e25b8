"""A rosbag2 SQLite file (.db3) as a storage file of a bag, read through rosbags."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat
from rosbags.rosbag2 import Reader

from ft_manip_ros.bags.qos import QosProfile
from ft_manip_ros.bags.source import BagMessage, Damage, Stretch, TopicInfo
from ft_manip_ros.core.errors import InputError

_ENCODINGS = {MessageDefinitionFormat.MSG: 'ros2msg', MessageDefinitionFormat.IDL: 'ros2idl'}


class SqliteSource:
    """A .db3 file; SQLite keeps its own integrity, so it is whole or refused.

    Raises
    ------
    InputError
        If the file is no rosbag2 database.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damage: list[Damage] = []
        self.finished = True
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, tuple[str, bytes]] = {}
        self._reader = Reader(path)
        try:
            self._reader.open()
            self.start = self._reader.start_time if self._reader.message_count else 0
            self.end = self._reader.end_time - 1 if self._reader.message_count else 0
            self._connections = list(self._reader.connections)
        except Exception as error:  # noqa: BLE001 (SQLite's and rosbags' errors have no common root)
            raise InputError(f'bag file {path}', f'is no rosbag2 database ({error})') from None

    def topics(self) -> dict[str, TopicInfo]:
        """Topics by name."""
        found: dict[str, TopicInfo] = {}
        for connection in self._connections:
            info = found.setdefault(
                connection.topic,
                TopicInfo(connection.msgtype, connection.digest, 0, _qos(connection)),
            )
            info.count += connection.msgcount
        return found

    def schemas(self) -> list[tuple[str, str, str]]:
        """(type name, encoding, text) of the schemas in the file; old bags have none."""
        return [
            (c.msgtype, _ENCODINGS[c.msgdef.format], c.msgdef.data)
            for c in self._connections
            if c.msgdef.format in _ENCODINGS
        ]

    def messages(self, wanted: Collection[str] | None = None) -> Iterator[BagMessage]:
        """Messages of these topics (None: all) by log time, then topic.

        Raises
        ------
        InputError
            Where the database turns out to be damaged.
        """
        held: list[BagMessage] = []
        chosen = [c for c in self._connections if wanted is None or c.topic in wanted]
        if not chosen:
            return
        for connection, log_time, data in self._rows(chosen):
            if held and held[0].log_time != log_time:
                yield from sorted(held, key=lambda message: message.topic)
                held.clear()
            held.append(
                BagMessage(connection.topic, connection.msgtype, log_time, log_time, bytes(data))
            )
        yield from sorted(held, key=lambda message: message.topic)

    def stretches(
        self, wanted: Collection[str], together: Collection[str]
    ) -> Iterator[BagMessage | Stretch]:
        """As `messages`: a row of the database is one message."""
        return self.messages(wanted)

    def _rows(self, chosen: list[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        read = 0
        try:
            for row in self._reader.messages(chosen):
                yield row
                read += 1
        except Exception as error:  # noqa: BLE001 (as above)
            raise InputError(
                f'bag file {self.path}',
                f'is damaged: {read} messages were read, then {error} '
                '(the .recover command of the sqlite3 shell may save more)',
            ) from None


def _qos(connection: Connection) -> tuple[QosProfile, ...]:
    assert isinstance(connection.ext, ConnectionExtRosbag2)
    return tuple(
        QosProfile(
            history=offered.history.name.lower(),
            depth=offered.depth,
            reliability=offered.reliability.name.lower(),
            durability=offered.durability.name.lower(),
            liveliness=offered.liveliness.name.lower(),
        )
        for offered in connection.ext.offered_qos_profiles
    )
