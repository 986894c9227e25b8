"""Joint states decoded many at once: most of a replay is reading them.

Consecutive messages of one driver differ in stamp and numbers alone. They are laid side by side
as rows of bytes, and columns are taken out; what does not match is left to the ordinary decoder.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.bags.decode import Decoder
from ft_manip_ros.bags.reader import Bag
from ft_manip_ros.bags.source import BagMessage, Stretch
from ft_manip_ros.core.errors import InputError

_TYPE = 'sensor_msgs/msg/JointState'
_LARGEST = 500  # messages of a block
_LITTLE_ENDIAN = b'\0\1'
_HEADER = 4  # bytes of the CDR header
_SECOND = 1_000_000_000
Array = NDArray[np.float64]


@dataclass(frozen=True)
class JointBlock:
    """K joint states of the same m names.

    Attributes
    ----------
    stamps, arrivals : ndarray of int64, shape (K,), ns
        Header stamps and log times.
    positions, velocities, efforts : ndarray, shape (K, m) or (K, 0)
        As in the messages.
    """

    topic: str
    names: tuple[str, ...]
    stamps: NDArray[np.int64]
    arrivals: NDArray[np.int64]
    positions: Array
    velocities: Array
    efforts: Array

    def part(self, rows: slice) -> JointBlock:
        """Some of them."""
        return JointBlock(
            self.topic,
            self.names,
            self.stamps[rows],
            self.arrivals[rows],
            self.positions[rows],
            self.velocities[rows],
            self.efforts[rows],
        )


class JointLayout:
    """Where the parts of joint states lie whose names and lengths are those of one message.

    Parameters
    ----------
    data
        Bytes of the message.
    message
        The same, decoded.
    """

    def __init__(self, data: bytes, message: Any) -> None:
        self.names = tuple(message.name)
        self.size = len(data)
        fixed = np.zeros(self.size, dtype=np.bool_)
        fixed[:2] = True
        at = _string(fixed, 8, message.header.frame_id)
        at = _count(fixed, at)
        for name in self.names:
            at = _string(fixed, at, name)
        self._columns = []
        for key in ('position', 'velocity', 'effort'):
            at = _count(fixed, at)
            length = len(getattr(message, key))
            # Bytes that align are the serializer's and mean nothing; so are those at the end.
            at += -at % 8 if length else 0
            self._columns.append((_HEADER + at, length))
            at += 8 * length
        self._fixed = fixed
        self._values = np.frombuffer(data, dtype=np.uint8)
        m = len(self.names)
        self.plain = (
            data[:2] == _LITTLE_ENDIAN
            and len(set(self.names)) == m > 0
            and all(length in (0, m) for _, length in self._columns)
        )

    def block(self, stretch: Stretch) -> JointBlock | None:
        """Decode messages of the layout's size, or return None where one has another layout."""
        rows = stretch.data
        arrivals = stretch.log_times.astype(np.int64)
        if ((rows != self._values) & self._fixed).any() or arrivals.min() < 0:
            return None
        times = np.ascontiguousarray(rows[:, _HEADER : _HEADER + 8])
        seconds = times.view('<i4')[:, 0].astype(np.int64)
        nanoseconds = times.view('<u4')[:, 1].astype(np.int64)
        tables = [
            rows[:, at : at + 8 * length].copy().view('<f8').reshape(len(rows), length)
            for at, length in self._columns
        ]
        stamps = seconds * _SECOND + nanoseconds
        return JointBlock(stretch.topic, self.names, stamps, arrivals, *tables)


def joint_runs(
    bag: Bag, wanted: Collection[str], blocks: Collection[str], start: int | None, end: int | None
) -> Iterator[BagMessage | JointBlock]:
    """Messages of a bag in order: joint states in blocks, all else one by one.

    Parameters
    ----------
    wanted
        Topics.
    blocks
        Those of them that hold joint states (`is_joint_state`).
    start, end
        As for `Bag.messages`.
    """
    layouts: dict[str, JointLayout] = {}
    run: list[BagMessage] = []
    topic, size = '', 0
    for item in bag.stretches(wanted, blocks, start=start, end=end):
        if run:
            if (
                isinstance(item, BagMessage)
                and item.topic == topic
                and item.type_name == _TYPE
                and len(item.data) == size
                and len(run) < _LARGEST
            ):
                run.append(item)
                continue
            yield from _decoded(layouts, _side_by_side(run))
            run = []
        if isinstance(item, Stretch):
            first = next(item.messages())
            if item.type_name == _TYPE and _learn(bag, layouts, first):
                yield from _decoded(layouts, item)
            else:
                yield from item.messages()
        elif item.topic in blocks and item.type_name == _TYPE and _learn(bag, layouts, item):
            run.append(item)
            topic, size = item.topic, len(item.data)
        else:
            yield item
    if run:
        yield from _decoded(layouts, _side_by_side(run))


def is_joint_state(bag: Bag, topic: str) -> bool:
    """Whether the topic's messages have the fields of today's sensor_msgs/JointState."""
    if bag.topics[topic].type_name != _TYPE:
        return False
    try:
        return bag.schema_of(_TYPE) == Decoder().fields(_TYPE)
    except InputError:
        return False


def _learn(bag: Bag, layouts: dict[str, JointLayout], record: BagMessage) -> bool:
    """Know the layout of a record's size; False where it has none that is plain."""
    layout = layouts.get(record.topic)
    if layout is None or layout.size != len(record.data):
        try:
            layout = JointLayout(record.data, bag.decode(record))
        except InputError:
            return False
        layouts[record.topic] = layout
    return layout.plain


def _side_by_side(run: list[BagMessage]) -> Stretch:
    data = np.frombuffer(b''.join(record.data for record in run), dtype=np.uint8)
    log_times = np.array([record.log_time for record in run], dtype=np.uint64)
    publish_times = np.array([record.publish_time for record in run], dtype=np.uint64)
    rows = data.reshape(len(run), -1)
    return Stretch(run[0].topic, run[0].type_name, log_times, publish_times, rows)


def _decoded(
    layouts: dict[str, JointLayout], stretch: Stretch
) -> Iterator[BagMessage | JointBlock]:
    block = layouts[stretch.topic].block(stretch)
    if block is not None:
        yield block
        return
    # Another driver's messages of the same size, or damage: learn again from the next one.
    del layouts[stretch.topic]
    yield from stretch.messages()


def _count(fixed: NDArray[np.bool_], at: int) -> int:
    """Mark the length of a sequence; offsets are those after the CDR header."""
    at += -at % 4
    fixed[_HEADER + at : _HEADER + at + 4] = True
    return at + 4


def _string(fixed: NDArray[np.bool_], at: int, text: str) -> int:
    start = at + -at % 4
    end = start + 4 + len(text.encode()) + 1
    fixed[_HEADER + start : _HEADER + end] = True
    return end
