"""Files that appear whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ft_manip_ros.core.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a place beside ``path`` to write to, and move it there, so that nobody sees half.

    Raises
    ------
    InputError
        If the folder is missing or cannot be written; what was there before stays.
    """
    target = Path(path)
    # With its suffix, by which libraries choose what they write.
    partial = target.with_name(f'.{target.stem}.{os.getpid()}{target.suffix}')
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


def write_figure(path: str | os.PathLike[str], figure: Figure, dpi: int) -> None:
    """Write a picture as `whole_file` does, in the format of its suffix, and close the figure.

    Raises
    ------
    InputError
        Also for a suffix that matplotlib knows no format of.
    """
    from matplotlib import pyplot as plt

    try:
        with whole_file(path) as partial:
            figure.savefig(partial, dpi=dpi)
    except ValueError as error:
        raise InputError(str(path), f'cannot be written: {error}') from None
    finally:
        plt.close(figure)
