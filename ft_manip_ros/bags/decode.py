"""CDR bytes to message objects, by the schema in the bag or the installed definition."""

from __future__ import annotations

import re
import struct
from typing import Any

from ft_manip_ros.bags.cdr_reader import CdrError, CdrReader, Read
from ft_manip_ros.bags.definitions import message_definition
from ft_manip_ros.bags.schema import Field, SchemaError, parse_schema, short_name
from ft_manip_ros.core.errors import InputError

# rosbag2 heads each of the definitions in a schema; the grammar knows nothing of it.
_IDL_HEADING = re.compile(r'^(=+|IDL: .*)$', re.MULTILINE)
_ORDERS = '><'  # by the second byte of the CDR header


class Decoder:
    """Decodes messages of the types it was told of.

    The objects have the fields of the ROS messages (numeric arrays as numpy arrays), so that
    what reads a message by attribute works on them too.
    """

    def __init__(self) -> None:
        self._schemas: dict[str, tuple[str, str]] = {}
        self._readers: dict[tuple[str, int], Read] = {}

    def add_schema(self, type_name: str, encoding: str, text: str) -> None:
        """Use this schema ('ros2msg' or 'ros2idl') for a type; the first one told counts."""
        if text:
            self._schemas.setdefault(type_name, (encoding, text))

    def fields(self, type_name: str) -> dict[str, tuple[Field, ...]]:
        """Fields of a type and of those that it nests; nothing where its schema is no ros2msg.

        Raises
        ------
        InputError
            If the type is unknown or its schema unreadable.
        """
        encoding, text = self._schema(type_name)
        try:
            return parse_schema(text, type_name) if encoding == 'ros2msg' else {}
        except SchemaError as error:
            raise _unreadable(type_name, error) from None

    def decode(self, type_name: str, data: bytes) -> Any:
        """Return the message.

        Raises
        ------
        InputError
            If the type is unknown, its schema unreadable or the bytes do not fit it.
        """
        if len(data) < 4 or data[0] != 0 or data[1] not in (0, 1):
            raise InputError(
                f'message of type {type_name}', 'does not begin with a plain CDR header'
            )
        read = self._readers.get((type_name, data[1]))
        if read is None:
            read = self._readers[type_name, data[1]] = self._build(type_name, data[1])
        try:
            # Spare bytes at the end are ignored: ROS's own serialization leaves some.
            return read(data[4:], 0)[0]
        except (CdrError, struct.error, UnicodeDecodeError) as error:
            raise InputError(
                f'message of type {type_name}',
                f'its {len(data)} bytes do not fit its schema ({_short(error)})',
            ) from None

    def _build(self, type_name: str, order: int) -> Read:
        """Put together what reads the type in this byte order."""
        encoding, text = self._schema(type_name)
        if encoding in ('ros2idl', 'omgidl'):
            return _idl_reader(type_name, text, order)
        if encoding != 'ros2msg':
            raise InputError(
                f'schema of {type_name}',
                f'has encoding {encoding!r}; known are ros2msg and ros2idl',
            )
        try:
            return CdrReader(self.fields(type_name), _ORDERS[order]).reader(short_name(type_name))
        except (SchemaError, RecursionError) as error:
            raise _unreadable(type_name, error) from None

    def _schema(self, type_name: str) -> tuple[str, str]:
        """Encoding and text."""
        if type_name in self._schemas:
            return self._schemas[type_name]
        return 'ros2msg', message_definition(type_name).text


def _unreadable(type_name: str, error: Exception) -> InputError:
    return InputError(f'schema of {type_name}', f'is not readable ({_short(error)})')


def _idl_reader(type_name: str, text: str, order: int) -> Read:
    """Reader of a type by its IDL, which rosbags parses."""
    # Loaded only here: parsers take a while to import, and hardly any bag has IDL.
    from rosbags.typesys import Stores, get_types_from_idl, get_typestore

    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_idl(_IDL_HEADING.sub('', text)))
        definition = store.get_msgdef(type_name)
    except Exception as error:  # noqa: BLE001 (a parser fed with damaged text)
        raise _unreadable(type_name, error) from None
    read = definition.deserialize_cdr_le if order else definition.deserialize_cdr_be

    def guarded(data: bytes, at: int) -> tuple[Any, int]:
        try:
            return read(data, at, definition.cls, store)
        except Exception as error:  # noqa: BLE001 (generated code fails in many ways on bad bytes)
            raise CdrError(_short(error)) from None

    return guarded


def _short(error: Exception) -> str:
    lines = str(error).splitlines()
    return f'{type(error).__name__}: {lines[0]}' if lines else type(error).__name__
