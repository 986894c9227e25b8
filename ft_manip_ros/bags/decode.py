"""CDR bytes to message objects, by the schema in the bag or the installed definition."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from ft_manip_ros.bags.definitions import message_definition
from ft_manip_ros.core.errors import InputError

if TYPE_CHECKING:
    from rosbags.interfaces import Typestore

# rosbag2 heads each of the definitions in a schema; the grammar knows nothing of it.
_IDL_HEADING = re.compile(r'^(=+|IDL: .*)$', re.MULTILINE)


class Decoder:
    """Decodes messages of the types it was told of, with rosbags.

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

    def fields(self, type_name: str) -> dict[str, Any]:
        """Fields of a type and of those that it nests by type name, in rosbags' terms.

        Raises
        ------
        InputError
            If the type is unknown or its schema unreadable.
        """
        definitions = self._store(type_name)[0].fielddefs
        return {name: fields for name, (_, fields) in definitions.items()}

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
        store, name = self._store(type_name)
        try:
            definition = store.get_msgdef(name)
            read = definition.deserialize_cdr_le if data[1] else definition.deserialize_cdr_be
        except Exception as error:  # noqa: BLE001 (a generator fed with a damaged definition)
            raise _unreadable(type_name, error) from None
        try:
            # Spare bytes at the end are ignored: ROS's own serialization leaves some.
            return read(data[4:], 0, definition.cls, store)[0]
        except Exception as error:  # noqa: BLE001 (generated code fails in many ways on bad bytes)
            raise InputError(
                f'message of type {type_name}',
                f'its {len(data)} bytes do not fit its schema ({_short(error)})',
            ) from None

    def _store(self, type_name: str) -> tuple[Typestore, str]:
        """Return what reads the type, and its name there."""
        if type_name not in self._stores:
            self._stores[type_name] = _build(type_name, *self._schema(type_name))
        return self._stores[type_name]

    def _schema(self, type_name: str) -> tuple[str, str]:
        """Encoding and text."""
        if type_name in self._schemas:
            return self._schemas[type_name]
        return 'ros2msg', message_definition(type_name).text


@lru_cache(maxsize=256)
def _build(type_name: str, encoding: str, text: str) -> tuple[Typestore, str]:
    """Parse a schema; generated code is kept, for it takes longer than reading a short bag.

    A store for each type, for two may nest different versions of a third; and the name that it
    has in there: rosbags files those of services in a way of its own.
    """
    # Loaded only here: what needs no message decoded needs no parsers.
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    if encoding not in ('ros2msg', 'ros2idl', 'omgidl'):
        raise InputError(
            f'schema of {type_name}',
            f'has encoding {encoding!r}; known are ros2msg and ros2idl',
        )
    store = get_typestore(Stores.EMPTY)
    name = type_name
    try:
        if encoding == 'ros2msg':
            types = get_types_from_msg(text, type_name)
            name = next(iter(types))
        else:
            types = get_types_from_idl(_IDL_HEADING.sub('', text))
        store.register(types)
    except Exception as error:  # noqa: BLE001 (a parser fed with damaged text)
        raise _unreadable(type_name, error) from None
    if name not in types:
        raise InputError(f'schema of {type_name}', 'does not define it')
    return store, name


def _unreadable(type_name: str, error: Exception) -> InputError:
    return InputError(f'schema of {type_name}', f'is not readable ({_short(error)})')


def _short(error: Exception) -> str:
    lines = str(error).splitlines()
    return f'{type(error).__name__}: {lines[0]}' if lines else type(error).__name__
