"""Compile every numba kernel once, so that nodes started together find them compiled.

Compiled code is kept in ``__pycache__`` beside the sources; without this, each of the processes
of a first demo or test would compile the same kernels at the same time.
"""

from __future__ import annotations

import importlib
import pkgutil
import sys
import time

import ft_manip_ros.core


def main() -> None:
    """Call `warm_up()` of every module below `ft_manip_ros.core` that has one."""
    start = time.monotonic()
    for module in pkgutil.walk_packages(ft_manip_ros.core.__path__, 'ft_manip_ros.core.'):
        warm_up = getattr(importlib.import_module(module.name), 'warm_up', None)
        if warm_up is not None:
            warm_up()
    elapsed = time.monotonic() - start
    if elapsed > 10.0:
        print(f'set-up: compiled the kernels in {elapsed:.0f} s', file=sys.stderr)


if __name__ == '__main__':
    main()
