"""What every storage file of a bag offers, whatever its format."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

from ft_manip_ros.bags.qos import QosProfile


@dataclass(frozen=True)
class Damage:
    """A place of a file that cannot be used: offset in bytes and what is wrong there."""

    file: str
    offset: int
    problem: str

    def __str__(self) -> str:
        return f'{self.file}: byte {self.offset}: {self.problem}'


class BagMessage(NamedTuple):
    """One recorded message: topic, type, reception and sending time (ns), CDR bytes."""

    topic: str
    type_name: str
    log_time: int
    publish_time: int
    data: bytes


@dataclass
class TopicInfo:
    """One topic of a bag."""

    type_name: str
    type_hash: str = ''
    count: int = 0
    qos: tuple[QosProfile, ...] = ()
    readable: bool = True


class Source(Protocol):
    """One storage file of a bag."""

    path: Path
    damage: list[Damage]
    finished: bool
    start: int
    end: int
    metadata: dict[str, dict[str, str]]
    attachments: dict[str, tuple[str, bytes]]

    def topics(self) -> dict[str, TopicInfo]:
        """Topics by name."""
        ...

    def schemas(self) -> list[tuple[str, str, str]]:
        """(type name, encoding, text) of all schemas."""
        ...

    def messages(self, wanted: Collection[str] | None = None) -> Iterator[BagMessage]:
        """Readable messages of these topics (None: all) by log time, then topic."""
        ...
