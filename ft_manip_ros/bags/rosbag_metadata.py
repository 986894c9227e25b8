"""The ``metadata.yaml`` of a rosbag2 folder, version 9."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from ft_manip_ros.bags.qos import QosProfile
from ft_manip_ros.bags.yaml_text import load_yaml
from ft_manip_ros.core.errors import InputError

VERSION = 9
FILE_NAME = 'metadata.yaml'


@dataclass
class TopicRecord:
    """One topic of a bag with the number of messages written so far."""

    name: str
    type_name: str
    type_hash: str
    qos: tuple[QosProfile, ...]
    count: int = 0


@dataclass
class FileRecord:
    """One file of a bag: name, first and last log time (ns), message count."""

    name: str
    start: int = 0
    end: int = 0
    count: int = 0

    def add(self, log_time: int) -> None:
        """Count one message."""
        self.start = log_time if self.count == 0 else min(self.start, log_time)
        self.end = max(self.end, log_time)
        self.count += 1


@dataclass
class BagMetadata:
    """What ``metadata.yaml`` says of a bag."""

    topics: list[TopicRecord] = field(default_factory=list)
    files: list[FileRecord] = field(default_factory=list)
    custom: dict[str, str] = field(default_factory=dict)
    ros_distro: str = field(default_factory=lambda: os.environ.get('ROS_DISTRO', 'jazzy'))

    def as_dict(self) -> dict[str, Any]:
        """The file's content."""
        filled = [record for record in self.files if record.count]
        start = min((record.start for record in filled), default=0)
        end = max((record.end for record in filled), default=0)
        return {
            'rosbag2_bagfile_information': {
                'version': VERSION,
                'storage_identifier': 'mcap',
                'duration': {'nanoseconds': end - start},
                'starting_time': {'nanoseconds_since_epoch': start},
                'message_count': sum(record.count for record in self.files),
                'topics_with_message_count': [_topic(topic) for topic in self.topics],
                # MCAP compresses its own chunks: these two are for rosbag2's own compression.
                'compression_format': '',
                'compression_mode': '',
                'relative_file_paths': [record.name for record in self.files],
                'files': [_file(record) for record in self.files],
                'custom_data': self.custom or None,
                'ros_distro': self.ros_distro,
            }
        }

    def text(self) -> str:
        """The file's content as YAML."""
        return yaml.safe_dump(self.as_dict(), sort_keys=False)

    def write(self, folder: Path) -> None:
        """Write the file whole or not at all."""
        part = folder / f'.{FILE_NAME}.part'
        part.write_text(self.text(), encoding='utf-8')
        part.replace(folder / FILE_NAME)


def read_file_names_and_custom(path: Path) -> tuple[list[str], dict[str, str], str]:
    """File names, custom data and storage of a ``metadata.yaml`` by any recorder.

    Raises
    ------
    InputError
        If the file is no rosbag2 metadata; the message names the missing key.
    """
    try:
        content = load_yaml(path.read_text(encoding='utf-8'))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(
            str(path), f'is not readable YAML ({str(error).splitlines()[0]})'
        ) from None
    info = _mapping(content).get('rosbag2_bagfile_information')
    names = _mapping(info).get('relative_file_paths')
    if not isinstance(names, Sequence) or isinstance(names, str) or not names:
        raise InputError(
            f'{path}: rosbag2_bagfile_information.relative_file_paths',
            'is missing; a list of storage files is needed',
        )
    info = _mapping(info)
    custom = {str(k): str(v) for k, v in _mapping(info.get('custom_data')).items()}
    mode = str(info.get('compression_mode') or '').lower()
    if mode not in ('', 'none', 'storage'):
        raise InputError(
            f'{path}: compression_mode',
            f"is {mode!r}; only the storage's own compression is read "
            '(ros2 bag convert writes such a bag)',
        )
    return [str(name) for name in names], custom, str(info.get('storage_identifier') or 'mcap')


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _topic(topic: TopicRecord) -> dict[str, Any]:
    return {
        'topic_metadata': {
            'name': topic.name,
            'type': topic.type_name,
            'serialization_format': 'cdr',
            'offered_qos_profiles': [profile.as_dict() for profile in topic.qos],
            'type_description_hash': topic.type_hash,
        },
        'message_count': topic.count,
    }


def _file(record: FileRecord) -> dict[str, Any]:
    return {
        'path': record.name,
        'starting_time': {'nanoseconds_since_epoch': record.start},
        'duration': {'nanoseconds': record.end - record.start},
        'message_count': record.count,
    }
