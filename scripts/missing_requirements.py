"""Print the entries of ``requirements/ros.lock`` that a ROS installation lacks.

What the system has stays as it is, above all numpy and Pinocchio, of which there must not be
two: an entry is printed only where neither the package nor its module is found.
"""

from __future__ import annotations

import re
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path

LOCK = Path(__file__).parent.parent / 'requirements' / 'ros.lock'

# Import names that differ from the package's name.
MODULES = {
    'catkin-pkg': 'catkin_pkg',
    'empy': 'em',
    'python-dateutil': 'dateutil',
    'pyyaml': 'yaml',
    'ruamel-yaml': 'ruamel.yaml',
    'types-pyyaml': 'yaml-stubs',
}
# Pinocchio and what its wheels bring; all of it or, where Pinocchio is here, nothing.
PINOCCHIO = re.compile(r'(pin|libpinocchio|eigenpy|coal|libcoal|cmeel-.+)$')


def importable(module: str) -> bool:
    """Return whether Python finds a module."""
    try:
        return find_spec(module) is not None
    except (ImportError, ValueError):
        return False


def present(name: str) -> bool:
    """Return whether a package is here, however it was installed."""
    if PINOCCHIO.match(name):
        return importable('pinocchio')
    try:
        distribution(name)
    except PackageNotFoundError:
        return importable(MODULES.get(name, name.replace('-', '_')))
    return True


def main() -> None:
    """Print the missing entries, hashes included."""
    entries = re.split(r'^(?=[a-z])', LOCK.read_text(), flags=re.MULTILINE)
    for entry in filter(None, entries):
        if not present(entry.partition('==')[0]):
            print(entry, end='')


if __name__ == '__main__':
    main()
