"""Writing what is readable of an MCAP file into a whole one."""

from __future__ import annotations

from pathlib import Path

from ft_manip_ros.bags.definitions import MessageDefinition
from ft_manip_ros.bags.mcap_file import McapFile
from ft_manip_ros.bags.mcap_scan import McapScan


def copy_readable(scan: McapScan, target: McapFile) -> int:
    """Append everything readable in ``scan`` to ``target``; return the number of messages."""
    for name, values in scan.metadata.items():
        target.add_metadata(name, values)
    for name, (media_type, content) in scan.attachments.items():
        target.add_attachment(name, media_type, content)
    for channel in scan.channels.values():
        schema = scan.schemas.get(channel.schema_id)
        definition = MessageDefinition(
            schema.name if schema else '',
            schema.data.decode('utf-8', 'replace') if schema else '',
            channel.metadata.get('topic_type_hash', ''),
            schema.encoding if schema else '',
        )
        qos = channel.metadata.get('offered_qos_profiles', '')
        target.add_channel(str(channel.id), channel.topic, definition, qos)
    copied = 0
    # Not by topic: several publishers of one topic have channels of their own.
    keys = {channel.id: (channel.topic, str(channel.id)) for channel in scan.channels.values()}
    for _, key, log_time, publish_time, data in scan.messages_of(keys):
        target.add_message(key, data, log_time, publish_time)
        copied += 1
    return copied


def rewrite_file(path: Path) -> None:
    """Replace an unfinished MCAP file by a finished one with the same readable messages.

    Raises
    ------
    OSError
        If the disk refuses; the file is then as it was.
    """
    part = path.with_name(f'.{path.name}.part')
    part.unlink(missing_ok=True)
    try:
        target = McapFile(part)
        copy_readable(McapScan(path), target)
        target.close()
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
