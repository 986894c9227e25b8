"""Print what pip must add to a ROS installation, as requirements and constraints.

``missing_requirements.py REQUIREMENTS CONSTRAINTS`` writes two files: the packages of
``requirements/*.in`` that cannot be imported here, and versions to keep to. What the system has
stays as it is (above all numpy and Pinocchio, of which there must not be two), and what it lacks
comes in the locked version where that fits beside it.
"""

from __future__ import annotations

import re
import sys
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path

FOLDER = Path(__file__).parent.parent / 'requirements'

# Import names that differ from the package's name.
MODULES = {
    'colcon-common-extensions': 'colcon_core',
    'empy': 'em',
    'mcap-ros2-support': 'mcap_ros2',
    'pin': 'pinocchio',
    'pyyaml': 'yaml',
    'types-pyyaml': 'yaml-stubs',
}
# Their locked versions may want a newer numpy than the system's; pip finds one that does not.
FOLLOW_NUMPY = {'contourpy', 'llvmlite', 'matplotlib', 'numba', 'numpy', 'scipy'}


def normal(name: str) -> str:
    """Return a package name as the index spells it."""
    return re.sub(r'[-_.]+', '-', name).lower()


def wanted() -> dict[str, str]:
    """Return requirement by package name, without what ROS itself brings."""
    found = {}
    for path in sorted(FOLDER.glob('*.in')):
        for line in path.read_text().splitlines():
            name = normal(re.split(r'[^\w.-]', line.strip(), maxsplit=1)[0])
            if name and not name.startswith('ros-'):
                found[name] = line.strip()
    return found


def locked() -> dict[str, list[str]]:
    """Return the pins (version and marker) of each package in the lock."""
    pins: dict[str, list[str]] = {}
    for line in (FOLDER / 'requirements.lock').read_text().splitlines():
        match = re.match(r'([\w.-]+)(==[^\\]+)', line)
        if match:
            pins.setdefault(normal(match[1]), []).append((match[1] + match[2]).strip())
    return pins


def importable(name: str) -> bool:
    """Return whether a package is here, however it was installed."""
    try:
        return find_spec(MODULES.get(name, name.replace('-', '_'))) is not None
    except (ImportError, ValueError):
        return False


def main() -> None:
    """Write the two files named on the command line."""
    requirements = [line for name, line in wanted().items() if not importable(name)]
    constraints = []
    for name, pins in locked().items():
        try:
            constraints.append(f'{name}=={version(name)}')
        except PackageNotFoundError:
            if name not in FOLLOW_NUMPY:
                constraints += pins
    Path(sys.argv[1]).write_text(''.join(f'{line}\n' for line in requirements))
    Path(sys.argv[2]).write_text(''.join(f'{line}\n' for line in constraints))


if __name__ == '__main__':
    main()
