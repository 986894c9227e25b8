"""What the recorder tells about itself: diagnostics, losses, provenance of a bag."""

from __future__ import annotations

import os
import platform
import time
from importlib import metadata
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from ft_manip_ros.bags.recording import RecordingStatus

_PACKAGES = ('ft_manip_ros', 'numpy', 'numba', 'pin', 'mcap')


def losses(status: RecordingStatus, lost: int) -> str:
    """What is missing in a finished bag, in words; empty if nothing is."""
    parts = []
    if status.error:
        parts.append(f'the disk refuses: {status.error}')
    dropped = sum(status.dropped.values())
    for count, what in (
        (dropped, 'dropped for lack of memory'),
        (lost, 'lost by the middleware'),
        (status.received - dropped - status.written, 'not written'),
    ):
        if count > 0:
            parts.append(f'{count} {what}')
    return ', '.join(parts)


def diagnostic(
    name: str, status: RecordingStatus, lost: int, topics: int, folder: Path
) -> DiagnosticStatus:
    """State of a recording as a diagnostic."""
    dropped = sum(status.dropped.values())
    message = DiagnosticStatus(name=f'{name}: bag', hardware_id=name)
    message.level, message.message = DiagnosticStatus.OK, f'recording to {folder}'
    if dropped or lost:
        message.level = DiagnosticStatus.WARN
        message.message = f'{dropped} messages dropped, {lost} lost by the middleware'
    if status.error:
        message.level, message.message = DiagnosticStatus.ERROR, status.error
    values = {
        'bag': str(folder),
        'received': status.received,
        'written': status.written,
        'dropped': dropped,
        'lost by the middleware': lost,
        'bytes in memory': status.queued_bytes,
        'topics': topics,
        **{f'dropped on {topic}': count for topic, count in status.dropped.items()},
    }
    message.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return message


def provenance(note: str, seed: int | None) -> dict[str, str]:
    """Where, when and with what a bag is made."""
    values = {
        'python': platform.python_version(),
        'machine': f'{platform.system()} {platform.machine()}',
        'middleware': rclpy.get_rmw_implementation_identifier(),
        'ros_distro': os.environ.get('ROS_DISTRO', ''),
        'domain': os.environ.get('ROS_DOMAIN_ID', '0'),
        'started': time.strftime('%Y-%m-%dT%H:%M:%SZ', time.gmtime()),
        'note': note,
        'seed': '' if seed is None else str(seed),
    }
    for package in _PACKAGES:
        try:
            values[f'version.{package}'] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return {key: value for key, value in values.items() if value}
