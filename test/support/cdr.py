"""CDR bytes of ROS messages as they go over the wire, without rclpy's spare bytes at the end."""

from __future__ import annotations

from functools import cache
from typing import Any

from rclpy.serialization import serialize_message
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from ft_manip_ros.bags.definitions import message_definition


def type_name_of(message: Any) -> str:
    """Full ROS type name of a message object."""
    package, kind = type(message).__module__.split('.')[:2]
    return f'{package}/{kind}/{type(message).__name__}'


@cache
def _store(type_name: str) -> Typestore:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(message_definition(type_name).text, type_name))
    return store


def cdr(message: Any) -> bytes:
    """Serialize a message and cut it to its own length."""
    data = serialize_message(message)
    name = type_name_of(message)
    store = _store(name)
    definition = store.get_msgdef(name)
    _, length = definition.deserialize_cdr_le(data[4:], 0, definition.cls, store)
    return data[: 4 + length]
