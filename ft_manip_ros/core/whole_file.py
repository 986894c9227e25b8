"""Files that appear whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ft_manip_ros.core.errors import InputError


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a place beside ``path`` to write to, and move it there, so that nobody sees half.

    Raises
    ------
    InputError
        If the folder is missing or cannot be written; what was there before stays.
    """
    target = Path(path)
    partial = target.with_name(f'.{target.name}.{os.getpid()}')
    try:
        yield partial
        partial.replace(target)
    except OSError as error:
        raise InputError(str(target), f'cannot be written: {error.strerror}') from error
    finally:
        partial.unlink(missing_ok=True)


def write_whole(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file as `whole_file` does."""
    with whole_file(path) as partial:
        partial.write_text(text, encoding='utf-8')
