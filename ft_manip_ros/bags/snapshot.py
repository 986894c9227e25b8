"""Recording only around faults: a ring buffer in memory, written out when something happens."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

from ft_manip_ros.bags.definitions import MessageDefinition
from ft_manip_ros.bags.qos import QosProfile
from ft_manip_ros.bags.recording import (
    CLOSE_TIME,
    MESSAGE_OVERHEAD,
    Recorded,
    Recording,
    RecordingStatus,
)
from ft_manip_ros.bags.writer import BagWriter
from ft_manip_ros.bags.writer_settings import WriterSettings
from ft_manip_ros.core.errors import InputError

_SECOND = 1_000_000_000


class SnapshotRecording:
    """Keeps the last seconds in memory; a trigger writes them and what follows to a bag.

    It has the methods of `Recording`. Of latched topics the last message is kept however old it
    is, so that each snapshot begins with the task, the arm and the faults that hold.

    Parameters
    ----------
    folder
        Where the bags go, one folder each: ``snapshot_<date>_<time>_<number>``.
    settings
        Layout of the bags.
    before, after
        How much to keep (s, by time of arrival) before and after a trigger.
    capacity
        Bytes that the ring may hold; beyond that its oldest messages go, however young.
    announce
        Called with the folder of each bag that is begun.
    """

    def __init__(
        self,
        folder: Path,
        settings: WriterSettings,
        *,
        before: float,
        after: float,
        capacity: int,
        announce: Callable[[Path], None] = lambda folder: None,
    ) -> None:
        for key, value in (('before', before), ('after', after)):
            if not 0.0 <= value < float('inf'):
                raise InputError(key, f'is {value}; must be a finite time >= 0 s')
        if capacity <= 0:
            raise InputError('capacity', f'is {capacity}; must be a number of bytes > 0')
        self._folder = folder
        self._settings = settings
        self._before = round(before * _SECOND)
        self._after = round(after * _SECOND)
        self._capacity = capacity
        self._announce = announce
        self._ring: deque[Recorded] = deque()
        self._bytes = 0
        self._last: dict[str, Recorded] = {}
        self._latched: set[str] = set()
        self._topics: dict[tuple[str, str], tuple[MessageDefinition, tuple[QosProfile, ...]]] = {}
        self._notes: dict[str, dict[str, str]] = {}
        self._attachments: dict[str, tuple[str, bytes]] = {}
        self._current: Recording | None = None
        self._until = 0
        self._closing: list[tuple[Recording, threading.Thread]] = []
        self._received = 0
        self._finished = RecordingStatus()
        self.count = 0

    @property
    def span(self) -> float:
        """Seconds that the ring holds now."""
        return (self._ring[-1].log_time - self._ring[0].log_time) * 1e-9 if self._ring else 0.0

    def add_topic(
        self, topic: str, definition: MessageDefinition, qos: tuple[QosProfile, ...]
    ) -> None:
        """Announce a topic before its first message."""
        self._topics[topic, definition.type_name] = (definition, qos)
        if qos and all(profile.durability == 'transient_local' for profile in qos):
            self._latched.add(topic)
        if self._current is not None:
            self._current.add_topic(topic, definition, qos)

    def add_provenance(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record into every bag."""
        self._notes[name] = values
        if self._current is not None:
            self._current.add_provenance(name, values)

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a file to every bag."""
        self._attachments[name] = (media_type, data)
        if self._current is not None:
            self._current.add_attachment(name, media_type, data)

    def put(self, messages: list[Recorded]) -> None:
        """Take messages in; they reach a bag only if a trigger is near enough."""
        for message in messages:
            self._received += 1
            if self._current is not None and message.log_time > self._until:
                self._finish()
            if self._current is not None:
                self._current.put([message])
            self._ring.append(message)
            self._bytes += len(message.data) + MESSAGE_OVERHEAD
            oldest = message.log_time - self._before
            while self._ring and (self._ring[0].log_time < oldest or self._bytes > self._capacity):
                self._forget(self._ring.popleft())

    def trigger(self, stamp: int) -> None:
        """Keep what surrounds this moment (arrival time, ns); during a bag, prolong it."""
        self._until = max(self._until, stamp + self._after)
        if self._current is not None:
            return
        self.count += 1
        name = time.strftime('snapshot_%Y%m%d_%H%M%S') + f'_{self.count}'
        writer = BagWriter(self._folder / name, self._settings)
        self._current = Recording(writer, self._capacity)
        for (topic, _), (definition, qos) in self._topics.items():
            self._current.add_topic(topic, definition, qos)
        for name, values in self._notes.items():
            self._current.add_provenance(name, values)
        for name, (media_type, data) in self._attachments.items():
            self._current.add_attachment(name, media_type, data)
        self._current.put(sorted(self._last.values(), key=lambda m: m.log_time))
        self._current.put(list(self._ring))
        self._announce(writer.folder)

    def status(self) -> RecordingStatus:
        """Return the counts over all bags at this moment."""
        total = RecordingStatus(received=self._received, queued_bytes=self._bytes)
        parts = [self._finished, *(recording.status() for recording, _ in self._closing)]
        if self._current is not None:
            parts.append(self._current.status())
        for part in parts:
            total.written += part.written
            total.dropped += part.dropped
            total.error = total.error or part.error
        return total

    def close(self, timeout: float = CLOSE_TIME) -> RecordingStatus:
        """Finish the bag that is being written, if any, and return the final counts."""
        deadline = time.monotonic() + timeout
        if self._current is not None:
            self._finish()
        for _, thread in self._closing:
            thread.join(max(deadline - time.monotonic(), 0.0))
        return self.status()

    def _forget(self, message: Recorded) -> None:
        self._bytes -= len(message.data) + MESSAGE_OVERHEAD
        if message.topic in self._latched:
            self._last[message.topic] = message

    def _finish(self) -> None:
        """Close the current bag beside the callbacks; a disk may take its time."""
        finished, self._current = self._current, None
        assert finished is not None
        thread = threading.Thread(target=finished.close, args=(60.0,), daemon=True)
        thread.start()
        self._closing.append((finished, thread))
        for recording, closer in list(self._closing):
            if not closer.is_alive():
                self._closing.remove((recording, closer))
                status = recording.status()
                self._finished.written += status.written
                self._finished.dropped += status.dropped
                self._finished.error = self._finished.error or status.error
