"""CDR bytes to message objects, by the fields of a schema.

Reading code is put together once for each type. It takes a twentieth of the time that generating
Python source would, which is what a short replay consists of.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ft_manip_ros.bags.schema import NUMBER_CODES, Field, SchemaError

# Reads a value at an offset of the bytes after the CDR header; returns it and the next offset.
Read = Callable[[bytes, int], tuple[Any, int]]


class CdrError(ValueError):
    """Bytes that do not fit their schema."""


class Message:
    """A decoded message: the fields are its attributes; numeric arrays are numpy arrays."""

    __slots__: tuple[str, ...] = ()

    def __repr__(self) -> str:
        values = ', '.join(f'{name}={getattr(self, name)!r}' for name in self.__slots__)
        return f'{type(self).__name__}({values})'


class CdrReader:
    """Reads the types of one schema in one byte order.

    Parameters
    ----------
    types
        Fields by ``package/Name`` (`parse_schema`).
    order
        '<' or '>', as `struct` has them.
    """

    def __init__(self, types: Mapping[str, tuple[Field, ...]], order: str) -> None:
        self._types = types
        self._order = order
        self._length = struct.Struct(order + 'I').unpack_from
        self._readers: dict[str, Read | None] = {}

    def reader(self, name: str) -> Read:
        """Return the function that reads a message of the type ``package/Name``.

        Raises
        ------
        SchemaError
            For a type that is not in the schema, or that contains itself.
        """
        if name not in self._readers:
            if name not in self._types:
                raise SchemaError(f'has no definition of {name}')
            self._readers[name] = None
            self._readers[name] = self._message(name, self._types[name])
        found = self._readers[name]
        if found is None:
            raise SchemaError(f'has a type {name} that contains itself')
        return found

    def _message(self, name: str, fields: tuple[Field, ...]) -> Read:
        kind: type = type(
            name.split('/')[-1], (Message,), {'__slots__': tuple(field.name for field in fields)}
        )
        # A message without fields takes a byte all the same.
        parts = [(field.name, self._field(field)) for field in fields]
        least = 0 if fields else 1

        def read(data: bytes, at: int) -> tuple[Any, int]:
            message = kind()
            at += least
            for field, part in parts:
                value, at = part(data, at)
                setattr(message, field, value)
            return message, at

        return read

    def _field(self, field: Field) -> Read:
        if field.length is None:
            return self._one(field.type_name)
        if field.type_name in NUMBER_CODES:
            return self._numbers(field.type_name, field.length)
        return self._many(self._one(field.type_name), field.length)

    def _one(self, type_name: str) -> Read:
        if type_name == 'string':
            return self._string()
        if type_name == 'wstring':
            raise SchemaError('has a wstring, which is not read here')
        if type_name not in NUMBER_CODES:
            return self.reader(type_name)
        unpack = struct.Struct(self._order + NUMBER_CODES[type_name]).unpack_from
        size = struct.calcsize(NUMBER_CODES[type_name])

        def read(data: bytes, at: int) -> tuple[Any, int]:
            at += -at % size
            return unpack(data, at)[0], at + size

        return read

    def _string(self) -> Read:
        length_at = self._length

        def read(data: bytes, at: int) -> tuple[str, int]:
            at += -at % 4
            end = at + 4 + length_at(data, at)[0]
            if end > len(data):
                raise CdrError('a string leaves the message')
            # The length counts a zero at the end.
            return data[at + 4 : max(end - 1, at + 4)].decode(), end

        return read

    def _numbers(self, type_name: str, count: int) -> Read:
        kind = np.dtype(self._order + NUMBER_CODES[type_name])
        size = kind.itemsize
        length_at = self._length

        def read(data: bytes, at: int) -> tuple[Any, int]:
            n = count
            if n < 0:
                at += -at % 4
                n = length_at(data, at)[0]
                at += 4
            if n:
                at += -at % size
            end = at + n * size
            if end > len(data):
                raise CdrError('an array leaves the message')
            return np.frombuffer(data, kind, n, at), end

        return read

    def _many(self, one: Read, count: int) -> Read:
        length_at = self._length

        def read(data: bytes, at: int) -> tuple[list[Any], int]:
            n = count
            if n < 0:
                at += -at % 4
                n = length_at(data, at)[0]
                at += 4
            # Every element takes a byte at least: damage must not cost memory.
            if n > len(data) - at:
                raise CdrError(f'a sequence claims {n} elements in {len(data) - at} bytes')
            values = []
            for _ in range(n):
                value, at = one(data, at)
                values.append(value)
            return values, at

        return read
