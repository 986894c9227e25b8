"""YAML text from bags: read fast, and safely whatever it is."""

from __future__ import annotations

from typing import Any

import yaml

# Ten times faster where PyYAML was built with the C library, which has no bound on nesting and
# ends the process where the stack ends: it gets only what cannot nest deeply.
_FAST = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
_BRACKETS = 500
_LINE = 500  # characters: a block nests at most as deep as it is indented, twice with lists


def load_yaml(text: str) -> Any:
    """What the text stands for.

    Raises
    ------
    yaml.YAMLError
        If it is no YAML, or nested too deeply.
    """
    brackets = text.count('[') + text.count('{')
    shallow = brackets <= _BRACKETS and all(len(line) <= _LINE for line in text.splitlines())
    try:
        return yaml.load(text, Loader=_FAST if shallow else yaml.SafeLoader)
    except RecursionError:
        raise yaml.YAMLError('it is nested too deeply') from None
