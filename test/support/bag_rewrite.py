"""Bags written again, with messages changed, left out or added."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from ft_manip_ros.bags.definitions import MessageDefinition, message_definition
from ft_manip_ros.bags.reader import Bag, BagMessage, open_bag
from ft_manip_ros.bags.writer import BagWriter


def definitions(bag: Bag) -> dict[str, MessageDefinition]:
    """What the bag says of its types, which may have grown since it was recorded."""
    return {
        name: MessageDefinition(name, text, '', encoding)
        for source in bag.sources
        for name, encoding, text in source.schemas()
    }


def rewrite(
    bag: Bag,
    folder: Path,
    change: Callable[[BagMessage], BagMessage | None] | None = None,
    extra: Iterable[BagMessage] = (),
) -> Bag:
    """Write a bag again with some messages changed, left out or added."""
    kinds = definitions(bag)
    with BagWriter(folder) as writer:
        for name, values in bag.provenance.items():
            if name != 'rosbag2':
                writer.add_provenance(name, values)
        for name, (media_type, content) in bag.attachments.items():
            writer.add_attachment(name, media_type, content)
        for message in bag.messages():
            changed = change(message) if change else message
            if changed is not None:
                key = writer.add_topic(changed.topic, kinds[changed.type_name])
                writer.write(key, changed.data, changed.log_time, changed.publish_time)
        for message in extra:
            key = writer.add_topic(message.topic, message_definition(message.type_name))
            writer.write(key, message.data, message.log_time, message.publish_time)
    return open_bag(folder)
