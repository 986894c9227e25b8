"""Text files that appear whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from ft_manip_ros.core.errors import InputError


def write_whole(path: str | os.PathLike[str], text: str) -> None:
    """Write a text file beside its place and move it there, so that nobody sees half of it.

    Raises
    ------
    InputError
        If the folder is missing or cannot be written; what was there before stays.
    """
    target = Path(path)
    partial = target.with_name(f'.{target.name}.{os.getpid()}')
    try:
        partial.write_text(text, encoding='utf-8')
        partial.replace(target)
    except OSError as error:
        raise InputError(str(target), f'cannot be written: {error.strerror}') from error
    finally:
        partial.unlink(missing_ok=True)
