"""Writing what is readable of any bag into a whole one: recovery and conversion."""

from __future__ import annotations

import shutil
from pathlib import Path

from ft_manip_ros.bags.definitions import MessageDefinition, message_definition
from ft_manip_ros.bags.reader import Bag
from ft_manip_ros.bags.writer import BagWriter
from ft_manip_ros.bags.writer_settings import WriterSettings
from ft_manip_ros.core.errors import InputError

# What the writer itself writes into every file.
_OWN = 'rosbag2'


def copy_bag(bag: Bag, folder: Path, settings: WriterSettings | None = None) -> int:
    """Write all readable messages, provenance and attachments into a new rosbag2 folder.

    Returns
    -------
    int
        Number of messages.

    Raises
    ------
    InputError
        If the folder exists, or the bag cannot be read to its end; nothing is left then.
    OSError
        If the disk refuses.
    """
    writer = BagWriter(folder, settings)
    try:
        with writer:
            _copy(bag, writer)
    except InputError:
        shutil.rmtree(folder)
        raise
    return bag.message_count


def _copy(bag: Bag, writer: BagWriter) -> None:
    definitions = _definitions(bag)
    for name, values in bag.provenance.items():
        if name != _OWN:
            writer.add_provenance(name, values)
    for name, (media_type, content) in bag.attachments.items():
        writer.add_attachment(name, media_type, content)
    for message in bag.messages():
        key = writer.add_topic(
            message.topic, definitions[message.type_name], bag.topics[message.topic].qos
        )
        writer.write(key, message.data, message.log_time, message.publish_time)


def _definitions(bag: Bag) -> dict[str, MessageDefinition]:
    """Definitions by type name: those in the bag, else those installed, else empty ones."""
    hashes = {info.type_name: info.type_hash for info in bag.topics.values()}
    found = {
        type_name: MessageDefinition(type_name, text, hashes.get(type_name, ''), encoding)
        for source in bag.sources
        for type_name, encoding, text in source.schemas()
        if text
    }
    for info in bag.topics.values():
        if info.type_name not in found:
            try:
                found[info.type_name] = message_definition(info.type_name)
            except InputError:
                found[info.type_name] = MessageDefinition(info.type_name, '', info.type_hash)
    return found
