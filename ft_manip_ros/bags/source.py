"""What every storage file of a bag offers, whatever its format."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.bags.qos import QosProfile


@dataclass(frozen=True)
class Damage:
    """A place of a file that cannot be used: offset in bytes and what is wrong there."""

    file: str
    offset: int
    problem: str

    def __str__(self) -> str:
        return f'{self.file}: byte {self.offset}: {self.problem}'


@dataclass(frozen=True)
class Stretch:
    """K consecutive messages of one topic and size.

    Attributes
    ----------
    log_times, publish_times : ndarray of uint64, shape (K,), ns
        Log times do not fall.
    data : ndarray of uint8, shape (K, size)
        CDR bytes, a message a row; not to be written to.
    """

    topic: str
    type_name: str
    log_times: NDArray[np.uint64]
    publish_times: NDArray[np.uint64]
    data: NDArray[np.uint8]

    def between(self, start: int | None, end: int | None) -> Stretch:
        """Those from ``start`` on and up to ``end``, log times in ns."""
        if start is None and end is None:
            return self
        times = self.log_times.tolist()
        first = 0 if start is None else bisect_left(times, start)
        last = len(times) if end is None else bisect_right(times, end)
        rows = slice(first, last)
        log_times, publish_times = self.log_times[rows], self.publish_times[rows]
        return Stretch(self.topic, self.type_name, log_times, publish_times, self.data[rows])

    def messages(self) -> Iterator[BagMessage]:
        """One by one."""
        times = zip(self.log_times.tolist(), self.publish_times.tolist(), strict=True)
        for (log_time, publish_time), row in zip(times, self.data, strict=True):
            yield BagMessage(self.topic, self.type_name, log_time, publish_time, row.tobytes())


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

    def stretches(
        self, wanted: Collection[str], together: Collection[str]
    ) -> Iterator[BagMessage | Stretch]:
        """As `messages`; those of the topics ``together`` may come in stretches."""
        ...
