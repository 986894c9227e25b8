"""Count what a bag holds with other people's readers: the mcap library and rosbags."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from mcap.reader import make_reader
from rosbags.rosbag2 import Reader


def count_with_mcap(folder: Path) -> Counter[str]:
    """Messages by topic that the mcap library reads in a bag folder, checksums verified."""
    counts: Counter[str] = Counter()
    for path in sorted(folder.glob('*.mcap')):
        with open(path, 'rb') as file:
            reader = make_reader(file, validate_crcs=True)
            counts.update(channel.topic for _, channel, _ in reader.iter_messages())
    return counts


def count_with_rosbags(folder: Path) -> Counter[str]:
    """Messages by topic that rosbags reads in a bag folder."""
    with Reader(folder) as reader:
        return Counter(connection.topic for connection, _, _ in reader.messages())
