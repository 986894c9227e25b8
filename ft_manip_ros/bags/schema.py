"""ros2msg schemas parsed into fields: what a CDR reader needs of them."""

from __future__ import annotations

import re
from typing import NamedTuple

_SEPARATOR = re.compile(r'^=+\s*$', re.MULTILINE)
_HEADING = re.compile(r'\s*MSG:\s*(\S+)\s*\n?')
_FIELD = re.compile(
    r'^(?P<type>[A-Za-z][\w/]*)(?P<bound><=\d+)?(?P<array>\[(?:<=)?\d*\])?\s+(?P<name>[a-z]\w*)'
    r'(?P<rest>.*)$'
)
_CONSTANT = re.compile(r'^[\w<=]+\s+[A-Z]\w*\s*=')


class SchemaError(ValueError):
    """A schema that is not in the ros2msg language."""


class Field(NamedTuple):
    """One field: name, element type, and how many.

    ``type_name`` is a primitive or ``package/Name``; ``length`` is None for a single value, -1 for
    a sequence and the length of a fixed array.
    """

    name: str
    type_name: str
    length: int | None


# `struct` codes of the numeric primitives.
NUMBER_CODES = {
    'bool': '?', 'byte': 'B', 'char': 'B', 'int8': 'b', 'uint8': 'B', 'int16': 'h', 'uint16': 'H',
    'int32': 'i', 'uint32': 'I', 'int64': 'q', 'uint64': 'Q', 'float32': 'f', 'float64': 'd',
}  # fmt: skip
PRIMITIVES = frozenset([*NUMBER_CODES, 'string', 'wstring'])


def parse_schema(text: str, type_name: str) -> dict[str, tuple[Field, ...]]:
    """Fields of a type and of all that it nests, by ``package/Name``.

    Parameters
    ----------
    text
        ros2msg schema as bags carry it: the type's own definition, then those of nested types.
    type_name
        Full name of the first definition.

    Raises
    ------
    SchemaError
        For a line that is neither field nor constant, or a definition without its name.
    """
    own, *nested = _SEPARATOR.split(text)
    found = {short_name(type_name): _fields(own, type_name.split('/')[0])}
    for part in nested:
        heading = _HEADING.match(part)
        if heading is None:
            raise SchemaError('a nested definition has no name')
        name = short_name(heading[1])
        found.setdefault(name, _fields(part[heading.end() :], name.split('/')[0]))
    return found


def short_name(type_name: str) -> str:
    """``package/Name`` of a type name with or without ``msg`` or ``srv`` in the middle."""
    parts = type_name.split('/')
    return f'{parts[0]}/{parts[-1]}'


def _fields(text: str, package: str) -> tuple[Field, ...]:
    fields = []
    for whole in text.splitlines():
        line = whole.strip()
        if not line or line[0] == '#' or _CONSTANT.match(line):
            continue
        match = _FIELD.match(line)
        if match is None:
            raise SchemaError(f'the line {line[:60]!r} is neither field nor constant')
        kind, array = match['type'], match['array']
        if kind not in PRIMITIVES:
            kind = short_name(kind) if '/' in kind else f'{package}/{kind}'
        count = None
        if array is not None:
            digits = array[1:-1]
            count = int(digits) if digits.isdigit() else -1
        fields.append(Field(match['name'], kind, count))
    return tuple(fields)
