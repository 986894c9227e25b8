"""YAML read strictly: every problem names the file and the line or the field it was found in."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ft_manip_ros.core.errors import InputError


class _StrictLoader(yaml.SafeLoader):
    """SafeLoader with the scalars of YAML 1.2 and without silently lost duplicate keys.

    YAML 1.1 reads ``1e-3`` as text and ``1:30`` as 90; a number file must do neither.
    """

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str):
                raise yaml.constructor.ConstructorError(
                    None, None, f'key {key!r} is not text', key_node.start_mark
                )
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f'key {key!r} is given twice', key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep)


_StrictLoader.yaml_implicit_resolvers = {}
_StrictLoader.add_implicit_resolver(
    'tag:yaml.org,2002:null', re.compile(r'^(?:~|null|Null|NULL|)$'), ['~', 'n', 'N', '']
)
_StrictLoader.add_implicit_resolver(
    'tag:yaml.org,2002:bool', re.compile(r'^(?:true|True|TRUE|false|False|FALSE)$'), list('tTfF')
)
_StrictLoader.add_implicit_resolver(
    'tag:yaml.org,2002:int', re.compile(r'^[-+]?(?:0|[1-9][0-9]*)$'), list('-+0123456789')
)
_StrictLoader.add_implicit_resolver(
    'tag:yaml.org,2002:float',
    re.compile(
        r'^(?:[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?'
        r'|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$'
    ),
    list('-+.0123456789'),
)


class Fields:
    """One mapping of a file, read key by key; `finish` refuses the keys nobody asked for.

    Parameters
    ----------
    values
        The mapping as parsed.
    where
        Prefix of every error, e.g. ``'arm.yaml: joints[2]'``.
    """

    def __init__(self, values: Any, where: str, separator: str = '.') -> None:
        if not isinstance(values, dict):
            raise InputError(where, f'is {_kind(values)}; a mapping of keys to values is needed')
        self._values: dict[str, Any] = values
        self._asked: list[str] = []
        self.where = where
        self._separator = separator

    def at(self, key: str) -> str:
        """Return the full name of a key, for error messages."""
        return f'{self.where}{self._separator}{key}'

    def has(self, key: str) -> bool:
        """Whether the file gives this key."""
        self._asked.append(key)
        return key in self._values

    def text(self, key: str, default: str | None = None) -> str:
        """Return a text that is not empty."""
        if not self.has(key):
            if default is None:
                raise InputError(self.at(key), 'is missing; a text is needed')
            return default
        value = self._values[key]
        if not isinstance(value, str) or not value.strip():
            raise InputError(self.at(key), f'is {_kind(value)}; a text is needed')
        return value

    def number(self, key: str, default: float | None = None) -> float:
        """Return a finite number."""
        if not self.has(key):
            if default is None:
                raise InputError(self.at(key), 'is missing; a number is needed')
            return default
        return _finite(self._values[key], self.at(key))

    def integer(self, key: str, default: int | None = None) -> int:
        """Return a whole number."""
        if not self.has(key):
            if default is None:
                raise InputError(self.at(key), 'is missing; a whole number is needed')
            return default
        value = self._values[key]
        if isinstance(value, bool) or not isinstance(value, int):
            raise InputError(self.at(key), f'is {_kind(value)}; a whole number is needed')
        return value

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        if not self.has(key):
            return default
        value = self._values[key]
        if not isinstance(value, bool):
            raise InputError(self.at(key), f'is {_kind(value)}; true or false is needed')
        return value

    def numbers(self, key: str, length: int) -> list[float]:
        """Return a list of finite numbers of a given length."""
        if not self.has(key):
            raise InputError(self.at(key), f'is missing; a list of {length} numbers is needed')
        value = self._values[key]
        if not isinstance(value, list) or len(value) != length:
            raise InputError(
                self.at(key), f'is {_kind(value)}; a list of {length} numbers is needed'
            )
        return [_finite(item, f'{self.at(key)}[{i}]') for i, item in enumerate(value)]

    def is_table(self, key: str) -> bool:
        """Whether the key's value is a list of lists."""
        value = self._values.get(key)
        return isinstance(value, list) and any(isinstance(row, list) for row in value)

    def pairs(self, key: str) -> list[tuple[float, float]]:
        """Return a list of pairs of finite numbers, at least one."""
        self._asked.append(key)
        value = self._values.get(key)
        if not isinstance(value, list) or not value:
            raise InputError(self.at(key), f'is {_kind(value)}; a list of pairs is needed')
        rows = Fields({f'[{i}]': row for i, row in enumerate(value)}, self.at(key), separator='')
        out = []
        for i in range(len(value)):
            low, high = rows.numbers(f'[{i}]', 2)
            out.append((low, high))
        return out

    def angle(self, key: str, default: float | None = None) -> float | None:
        """Return an angle in rad, given in rad under ``key`` or in degrees under ``key_deg``."""
        radians, degrees = self.has(key), self.has(f'{key}_deg')
        if radians and degrees:
            raise InputError(
                self.at(key), f'is given twice; keep one of {key} (rad) and {key}_deg'
            )
        if degrees:
            return float(np.deg2rad(self.number(f'{key}_deg')))
        return self.number(key) if radians else default

    def angles(self, key: str, length: int) -> list[float] | None:
        """Return a list of angles in rad under ``key`` or ``key_deg``, None where not given."""
        radians, degrees = self.has(key), self.has(f'{key}_deg')
        if radians and degrees:
            raise InputError(
                self.at(key), f'is given twice; keep one of {key} (rad) and {key}_deg'
            )
        if degrees:
            return [float(np.deg2rad(v)) for v in self.numbers(f'{key}_deg', length)]
        return self.numbers(key, length) if radians else None

    def mapping(self, key: str) -> Fields | None:
        """Return a nested mapping, None where not given."""
        return Fields(self._values[key], self.at(key)) if self.has(key) else None

    def mappings(self, key: str) -> list[Fields]:
        """Return a list of mappings with at least one entry."""
        value = self._values.get(key)
        self._asked.append(key)
        if not isinstance(value, list) or not value:
            found = 'is missing' if key not in self._values else f'is {_kind(value)}'
            raise InputError(self.at(key), f'{found}; a list with at least one entry is needed')
        return [Fields(item, f'{self.at(key)}[{i}]') for i, item in enumerate(value)]

    def finish(self) -> None:
        """Refuse keys that were never asked for, with those that are known."""
        for key in self._values:
            if key not in self._asked:
                known = ', '.join(dict.fromkeys(self._asked))
                raise InputError(self.at(key), f'is not a known key; known are {known}')


def read_fields(path: Path) -> Fields:
    """Return the top-level mapping of a YAML file.

    Raises
    ------
    InputError
        If the file cannot be read, is not YAML (with the line) or is not a mapping.
    """
    try:
        text = path.read_text(encoding='utf-8')
    except OSError as error:
        raise InputError(str(path), f'cannot be read: {error.strerror}') from error
    except UnicodeDecodeError as error:
        raise InputError(str(path), 'is not UTF-8 text') from error
    try:
        # A SafeLoader: it builds plain values only.
        values = yaml.load(text, Loader=_StrictLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f', line {mark.line + 1}' if mark is not None else ''
        raise InputError(f'{path}{line}', f'is not valid YAML: {error.problem}') from error
    except yaml.YAMLError as error:
        raise InputError(str(path), f'is not valid YAML: {error}') from error
    except RecursionError as error:
        raise InputError(str(path), 'is nested too deeply to be read') from error
    return Fields(values, str(path), separator=': ')


@contextmanager
def located(where: str) -> Iterator[None]:
    """Put the place in the file before the field of an `InputError` raised inside."""
    try:
        yield
    except InputError as error:
        raise InputError(f'{where}: {error.field}', error.problem) from error


def _finite(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(where, f'is {_kind(value)}; a number is needed')
    try:
        number = float(value)
    except OverflowError:
        number = float('inf')
    if not np.isfinite(number):
        raise InputError(where, f'is {number}; a finite number is needed')
    return number


def _kind(value: Any) -> str:
    """What was found, for a person to read."""
    if value is None:
        return 'empty'
    if isinstance(value, dict):
        return 'a mapping'
    if isinstance(value, list):
        return f'a list of {len(value)}'
    shown = repr(value)
    return shown if len(shown) <= 40 else f'{shown[:40]}...'
