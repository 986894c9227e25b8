"""CDR bytes to message objects, by the schema in the bag or the installed definition."""

from __future__ import annotations

from typing import Any

from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from ft_manip_ros.bags.definitions import message_definition
from ft_manip_ros.core.errors import InputError


class Decoder:
    """Decodes messages of the types it was told of.

    The objects have the fields of the ROS messages (numeric arrays as numpy arrays), so that
    what reads a message by attribute works on them too.
    """

    def __init__(self) -> None:
        self._schemas: dict[str, tuple[str, str]] = {}
        self._stores: dict[str, tuple[Typestore, str]] = {}

    def add_schema(self, type_name: str, encoding: str, text: str) -> None:
        """Use this schema ('ros2msg' or 'ros2idl') for a type; the first one told counts."""
        if text:
            self._schemas.setdefault(type_name, (encoding, text))

    def decode(self, type_name: str, data: bytes) -> Any:
        """Return the message.

        Raises
        ------
        InputError
            If the type is unknown, its schema unreadable or the bytes do not fit it.
        """
        if type_name not in self._stores:
            self._stores[type_name] = self._build(type_name)
        store, name = self._stores[type_name]
        if len(data) < 4 or data[0] != 0 or data[1] not in (0, 1):
            raise InputError(
                f'message of type {type_name}', 'does not begin with a plain CDR header'
            )
        definition = store.get_msgdef(name)
        read = definition.deserialize_cdr_le if data[1] else definition.deserialize_cdr_be
        try:
            # Not Typestore.deserialize_cdr: it refuses the spare bytes at the end that ROS's own
            # serialization leaves.
            return read(data[4:], 0, definition.cls, store)[0]
        except Exception as error:  # noqa: BLE001 (generated code fails in many ways on bad bytes)
            raise InputError(
                f'message of type {type_name}',
                f'its {len(data)} bytes do not fit its schema ({_short(error)})',
            ) from None

    def _build(self, type_name: str) -> tuple[Typestore, str]:
        """Parsed schema, and the name that rosbags gives the type."""
        if type_name in self._schemas:
            encoding, text = self._schemas[type_name]
        else:
            encoding, text = 'ros2msg', message_definition(type_name).text
        store = get_typestore(Stores.EMPTY)
        try:
            if encoding == 'ros2msg':
                types = get_types_from_msg(text, type_name)
                # It calls a service event pkg/srv/msg/Name_Event; the first type is the one asked.
                name = next(iter(types))
            elif encoding in ('ros2idl', 'omgidl'):
                types, name = get_types_from_idl(text), type_name
            else:
                raise InputError(
                    f'schema of {type_name}',
                    f'has encoding {encoding!r}; known are ros2msg and ros2idl',
                )
            store.register(types)
            store.get_msgdef(name)
        except InputError:
            raise
        except Exception as error:  # noqa: BLE001 (a parser fed with damaged text)
            raise InputError(
                f'schema of {type_name}', f'is not readable ({_short(error)})'
            ) from None
        return store, name


def _short(error: Exception) -> str:
    lines = str(error).splitlines()
    return f'{type(error).__name__}: {lines[0]}' if lines else type(error).__name__
