"""Recording beside the callbacks: a bounded queue, one writing thread, everything counted."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from dataclasses import dataclass, field
from typing import NamedTuple

from ft_manip_ros.bags.definitions import MessageDefinition
from ft_manip_ros.bags.qos import QosProfile
from ft_manip_ros.bags.writer import BagWriter
from ft_manip_ros.core.errors import InputError

# What a queued message costs beside its bytes: the tuple and its numbers.
MESSAGE_OVERHEAD = 200
# For a slow disk to take what waits in memory (s). `ros2 launch` kills what has not ended 10 s
# after Ctrl-C.
CLOSE_TIME = 6.0
_IDLE = 0.05  # s, longest wait of the thread before it looks at the flush interval
_RETRY = 1.0  # s, between attempts at a disk that refused


class Recorded(NamedTuple):
    """One message on its way to the bag; times in ns."""

    topic: str
    type_name: str
    log_time: int
    publish_time: int
    data: bytes


@dataclass
class RecordingStatus:
    """Counts since the recording began.

    Attributes
    ----------
    received, written
        Messages taken in, and messages that have reached the operating system.
    dropped
        Messages refused because the queue was full, by topic.
    queued_bytes
        Waiting in memory now.
    error
        Why the disk refuses, or empty.
    """

    received: int = 0
    written: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    queued_bytes: int = 0
    error: str = ''


class Recording:
    """A bag written by a thread of its own, so that a slow disk never holds up a callback.

    Parameters
    ----------
    writer
        The bag; from now on only the thread touches it.
    capacity
        Bytes that may wait in memory; messages beyond that are dropped and counted.
    """

    def __init__(self, writer: BagWriter, capacity: int) -> None:
        if capacity <= 0:
            raise InputError('capacity', f'is {capacity}; must be a number of bytes > 0')
        self._writer = writer
        self._capacity = capacity
        self._queue: deque[Recorded] = deque()
        self._topics: deque[tuple[str, MessageDefinition, tuple[QosProfile, ...]]] = deque()
        self._notes: deque[tuple[str, dict[str, str]]] = deque()
        self._attachments: deque[tuple[str, str, bytes]] = deque()
        self._keys: dict[tuple[str, str], str] = {}
        self._status = RecordingStatus()
        self._news = threading.Condition()
        self._closing = False
        self._retry_at = 0.0
        self._thread = threading.Thread(target=self._run, name='bag writer', daemon=True)
        self._thread.start()

    def add_topic(
        self, topic: str, definition: MessageDefinition, qos: tuple[QosProfile, ...]
    ) -> None:
        """Announce a topic before its first message."""
        with self._news:
            self._topics.append((topic, definition, qos))

    def add_provenance(self, name: str, values: dict[str, str]) -> None:
        """Write a metadata record as soon as possible."""
        with self._news:
            self._notes.append((name, values))

    def add_attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a file as soon as possible."""
        with self._news:
            self._attachments.append((name, media_type, data))

    def put(self, messages: list[Recorded]) -> None:
        """Queue messages in this order; what does not fit is dropped and counted."""
        with self._news:
            status = self._status
            for message in messages:
                size = len(message.data) + MESSAGE_OVERHEAD
                status.received += 1
                if status.queued_bytes + size > self._capacity:
                    status.dropped[message.topic] += 1
                    continue
                status.queued_bytes += size
                self._queue.append(message)
            self._news.notify()

    def status(self) -> RecordingStatus:
        """Return the counts at this moment."""
        with self._news:
            status = self._status
            return RecordingStatus(
                status.received,
                status.written,
                Counter(status.dropped),
                status.queued_bytes,
                status.error,
            )

    def close(self, timeout: float = CLOSE_TIME) -> RecordingStatus:
        """Write what is queued, finish the bag and return the final counts.

        Parameters
        ----------
        timeout
            Longest time (s) to wait for the disk. A bag that it did not finish is unfinished,
            not lost: readers and ``ftmanip bag recover`` take everything flushed so far.
        """
        with self._news:
            self._closing = True
            self._news.notify()
        self._thread.join(timeout)
        if self._thread.is_alive():
            self._status.error = self._status.error or f'not finished within {timeout} s'
        return self.status()

    def _run(self) -> None:
        try:
            self._write_until_closed()
        except OSError as error:
            self._note_error(str(error))
        except Exception as error:  # noqa: BLE001 - whatever it was, it must not pass unseen
            self._note_error(f'recording ended: {type(error).__name__}: {error}')

    def _write_until_closed(self) -> None:
        while True:
            with self._news:
                if not self._queue and not self._closing:
                    self._news.wait(_IDLE)
                closing = self._closing
            done = self._work(closing)
            if closing and done:
                break
        self._writer.close()
        self._note_error('')

    def _work(self, closing: bool) -> bool:
        """Write what is queued; True when nothing is left, or the disk refuses for good."""
        if not closing and time.monotonic() < self._retry_at:
            time.sleep(_IDLE)
            return False
        try:
            self._write_announcements()
            while (message := self._take()) is not None:
                self._writer.write(self._keys[message[:2]], message.data, *message[2:4])
            self._writer.tick()
            self._note_error('')
        except OSError as error:
            self._note_error(f'{error.strerror or error} ({self._writer.folder})')
            self._retry_at = time.monotonic() + _RETRY
        return True

    def _write_announcements(self) -> None:
        with self._news:
            topics, notes = list(self._topics), list(self._notes)
            attachments = list(self._attachments)
            self._topics.clear()
            self._notes.clear()
            self._attachments.clear()
        for topic, definition, qos in topics:
            key = self._writer.add_topic(topic, definition, qos)
            self._keys[topic, definition.type_name] = key
        for name, values in notes:
            self._writer.add_provenance(name, values)
        for name, media_type, data in attachments:
            self._writer.add_attachment(name, media_type, data)

    def _take(self) -> Recorded | None:
        with self._news:
            if not self._queue:
                return None
            message = self._queue.popleft()
            self._status.queued_bytes -= len(message.data) + MESSAGE_OVERHEAD
            return message

    def _note_error(self, error: str) -> None:
        with self._news:
            self._status.error = error
            self._status.written = self._writer.message_count
