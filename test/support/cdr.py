"""CDR bytes of ROS messages in a form that can be compared.

rclpy's serializer leaves whatever was in memory in the bytes that align fields, and spare bytes at
the end, so that the same message may be serialized to different bytes each time.
"""

from __future__ import annotations

from collections.abc import Callable
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
def _store(type_name: str, text: str) -> Typestore:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, type_name))
    return store


def edited(
    type_name: str, text: str, data: bytes, change: Callable[[Any], None] | None = None
) -> bytes:
    """A message of the definition ``text``, changed, in canonical bytes."""
    store = _store(type_name, text)
    definition = store.get_msgdef(type_name)
    message, _ = definition.deserialize_cdr_le(data[4:], 0, definition.cls, store)
    if change is not None:
        change(message)
    return bytes(store.serialize_cdr(message, type_name))


def canonical(type_name: str, data: bytes) -> bytes:
    """The same message with zeros between its fields and nothing after the last one."""
    return edited(type_name, message_definition(type_name).text, data)


def cdr(message: Any) -> bytes:
    """Serialize a message to its canonical bytes."""
    return canonical(type_name_of(message), serialize_message(message))
