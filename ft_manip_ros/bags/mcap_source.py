"""An MCAP file as a storage file of a bag."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

from ft_manip_ros.bags.mcap_scan import McapScan
from ft_manip_ros.bags.qos import load_profiles
from ft_manip_ros.bags.source import BagMessage, Stretch, TopicInfo


class McapSource:
    """A `McapScan` as a storage file of a bag."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._scan = McapScan(path)
        self.damage = self._scan.damage
        self.finished = self._scan.finished
        self.start, self.end = self._scan.start, self._scan.end
        self.metadata, self.attachments = self._scan.metadata, self._scan.attachments

    def topics(self) -> dict[str, TopicInfo]:
        """Topics by name; a topic of several types keeps its first."""
        found: dict[str, TopicInfo] = {}
        for channel in self._scan.channels.values():
            info = found.setdefault(
                channel.topic,
                TopicInfo(
                    self._scan.type_name(channel.schema_id),
                    channel.metadata.get('topic_type_hash', ''),
                    0,
                    load_profiles(channel.metadata.get('offered_qos_profiles', '')),
                    channel.message_encoding == 'cdr',
                ),
            )
            info.count += self._scan.counts[channel.id]
        return found

    def schemas(self) -> list[tuple[str, str, str]]:
        """(type name, encoding, text) of all schemas."""
        return [
            (schema.name, schema.encoding, schema.data.decode('utf-8', 'replace'))
            for schema in self._scan.schemas.values()
        ]

    def messages(self, wanted: Collection[str] | None = None) -> Iterator[BagMessage]:
        """Readable messages of these topics (None: all) by log time, then topic."""
        return self._scan.messages(wanted)

    def stretches(
        self, wanted: Collection[str], together: Collection[str]
    ) -> Iterator[BagMessage | Stretch]:
        """As `messages`; those of the topics ``together`` in stretches where they can."""
        return self._scan.stretches(wanted, together)
