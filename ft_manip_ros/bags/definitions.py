"""Message definitions as a bag carries them: ros2msg text of all nested types, RIHS01 hash."""

from __future__ import annotations

import json
import os
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from ft_manip_ros.core.errors import InputError

_SEPARATOR = '=' * 80
_BUILTIN = re.compile(r'bool|byte|char|float(32|64)|u?int(8|16|32|64)|w?string')
_FIELD_TYPE = re.compile(r'^\s*([A-Za-z][A-Za-z0-9_/]*)')
_TYPE_NAME = re.compile(r'^([a-z][a-z0-9_]*)/(msg|srv|action)/([A-Za-z][A-Za-z0-9_]*)$')
_SERVICE_PARTS = ('_Request', '_Response', '_Event')


@dataclass(frozen=True)
class MessageDefinition:
    """What readers need to decode one message type.

    Attributes
    ----------
    type_name
        Full name, e.g. ``sensor_msgs/msg/JointState``.
    text
        ros2msg schema: the definition followed by those of all nested types; empty where the
        machine has no definition of the type.
    type_hash
        RIHS01 hash, or empty where unknown.
    encoding
        What ``text`` is written in: 'ros2msg', or 'ros2idl' in bags of others.
    """

    type_name: str
    text: str
    type_hash: str
    encoding: str = 'ros2msg'


def split_type_name(type_name: str) -> tuple[str, str, str]:
    """Return (package, 'msg' | 'srv' | 'action', name).

    Raises
    ------
    InputError
        If ``type_name`` is not a full ROS 2 type name.
    """
    match = _TYPE_NAME.match(type_name)
    if match is None:
        raise InputError(
            f'type {type_name!r}', 'is not a type name like sensor_msgs/msg/JointState'
        )
    return match[1], match[2], match[3]


@cache
def message_definition(type_name: str) -> MessageDefinition:
    """Definition of a type from the ROS environment's interface packages.

    Raises
    ------
    InputError
        If the name is malformed or the type is not installed; the message names the package.
    """
    package, _, name = split_type_name(type_name)
    share = _share_folder(package, type_name)
    parts = [_own_text(type_name)]
    seen = {f'{package}/{name}'}
    queue = _nested_types(parts[0], package)
    while queue:
        short = queue.pop(0)
        if short in seen:
            continue
        seen.add(short)
        owner, nested = short.split('/')
        text = _own_text(f'{owner}/{_kind(owner, nested)}/{nested}')
        parts.append(f'{_SEPARATOR}\nMSG: {short}\n{text}')
        queue.extend(_nested_types(text, owner))
    return MessageDefinition(type_name, '\n'.join(parts), _type_hash(share, type_name))


def _share_folder(package: str, type_name: str) -> Path:
    prefixes = [p for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    for prefix in prefixes:
        folder = Path(prefix, 'share', package)
        if (folder / 'package.xml').is_file():
            return folder
    raise InputError(
        f'type {type_name!r}',
        f'package {package!r} is in none of the prefixes on AMENT_PREFIX_PATH '
        f'({", ".join(prefixes) or "not set: source the ROS environment"})',
    )


def _kind(package: str, name: str) -> str:
    """Nested types are messages, but for the parts of a service inside its event."""
    return 'srv' if name.endswith(_SERVICE_PARTS[:2]) and _is_service(package, name) else 'msg'


def _is_service(package: str, name: str) -> bool:
    share = _share_folder(package, f'{package}/srv/{name}')
    return (share / 'srv' / f'{name.rsplit("_", 1)[0]}.srv').is_file()


def _own_text(type_name: str) -> str:
    """Definition of one type alone, without those it nests."""
    package, kind, name = split_type_name(type_name)
    share = _share_folder(package, type_name)
    if kind == 'msg':
        return _read(share / 'msg' / f'{name}.msg', type_name)
    base = name.rsplit('_', 1)[0]
    if kind == 'srv' and name.endswith(_SERVICE_PARTS):
        request, _, response = _read(share / 'srv' / f'{base}.srv', type_name).partition('\n---')
        if name.endswith('_Event'):
            # As rosidl derives it; there is no file for it.
            return (
                'service_msgs/ServiceEventInfo info\n'
                f'{package}/{base}_Request[<=1] request\n'
                f'{package}/{base}_Response[<=1] response\n'
            )
        return (request if name.endswith('_Request') else response).strip('\n') + '\n'
    raise InputError(f'type {type_name!r}', 'is not a message or a part of a service')


def _read(path: Path, type_name: str) -> str:
    try:
        return path.read_text(encoding='utf-8')
    except FileNotFoundError:
        raise InputError(f'type {type_name!r}', f'has no definition at {path}') from None


def _nested_types(text: str, package: str) -> list[str]:
    """Short names (``package/Name``) of the types that a definition's fields use."""
    found = []
    for line in text.splitlines():
        match = _FIELD_TYPE.match(line)
        if match is None or _BUILTIN.fullmatch(match[1]):
            continue
        parts = match[1].split('/')
        found.append(f'{parts[0]}/{parts[-1]}' if len(parts) > 1 else f'{package}/{parts[0]}')
    return found


def _type_hash(share: Path, type_name: str) -> str:
    _, kind, name = split_type_name(type_name)
    base = name.rsplit('_', 1)[0] if kind == 'srv' and name.endswith(_SERVICE_PARTS) else name
    try:
        content = json.loads((share / kind / f'{base}.json').read_text(encoding='utf-8'))
        hashes = {entry['type_name']: entry['hash_string'] for entry in content['type_hashes']}
    except (OSError, ValueError, KeyError, TypeError):
        # The hash is a convenience for readers; a bag without it is still whole.
        return ''
    return str(hashes.get(type_name, ''))
