"""Where arm, task and parameter files are found: by path, by name, or inside a ROS package."""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path

from ft_manip_ros.core.errors import InputError

PACKAGE = 'ft_manip_ros'


def config_folder(kind: str) -> Path:
    """Return the folder of one kind of configuration file, e.g. ``'arms'``.

    The source tree comes first, so that a checkout uses its own files; an installed package
    has them in its ament share directory.

    Raises
    ------
    InputError
        If neither place has the folder.
    """
    source = Path(__file__).resolve().parents[2] / 'config' / kind
    if source.is_dir():
        return source
    share = _package_folder(PACKAGE)
    if share is not None and (share / 'config' / kind).is_dir():
        return share / 'config' / kind
    raise InputError(f'config/{kind}', f'is neither at {source} nor in the share of {PACKAGE}')


def find_config(kind: str, path_or_name: str | os.PathLike[str]) -> Path:
    """Return the file meant by a path or by the name of a file in ``config/<kind>``.

    Raises
    ------
    InputError
        If there is no such file; the message lists the names there are.
    """
    text = os.fspath(path_or_name)
    if not text:
        raise InputError(f'{kind} file', 'is empty; give a path or a name from ' + _names(kind))
    if text.startswith('package://'):
        return resolve_package_url(text)
    path = Path(text).expanduser()
    if path.is_file():
        return path
    if path.is_dir():
        raise InputError(text, 'is a folder; a file is needed')
    if path.parent == Path('.') and path.suffix in ('', '.yaml'):
        named = config_folder(kind) / f'{path.stem if path.suffix else path.name}.yaml'
        if named.is_file():
            return named
        raise InputError(text, f'is neither a file nor a name from {_names(kind)}')
    raise InputError(text, 'is not a file')


def resolve_package_url(url: str) -> Path:
    """Return the file meant by ``package://NAME/path``.

    NAME is looked up in the ament index, on ``ROS_PACKAGE_PATH`` and below the Python
    environment's own ``share`` folders (where PyPI packages keep their robot descriptions).

    Raises
    ------
    InputError
        If the package or the file is not found.
    """
    name, _, rest = url.removeprefix('package://').partition('/')
    if not name or not rest:
        raise InputError(url, 'is not of the form package://NAME/path/to/file')
    folder = _package_folder(name)
    if folder is None:
        raise InputError(url, f'no package {name!r} in the ament index or the Python environment')
    path = folder / rest
    if not path.is_file():
        raise InputError(url, f'there is no file {path}')
    return path


def _names(kind: str) -> str:
    names = sorted(path.stem for path in config_folder(kind).glob('*.yaml'))
    return f'config/{kind}: ' + ', '.join(names)


def _package_folder(name: str) -> Path | None:
    try:
        index = importlib.import_module('ament_index_python.packages')
        return Path(index.get_package_share_directory(name))
    except (ImportError, LookupError, ValueError, OSError):
        # No ament index, no prefix set, or no such package there: the other places are tried.
        pass
    roots = [Path(p) for p in os.environ.get('ROS_PACKAGE_PATH', '').split(os.pathsep) if p]
    for entry in sys.path:
        roots += [Path(entry) / 'cmeel.prefix' / 'share']
    roots.append(Path(sys.prefix) / 'share')
    for root in roots:
        if (root / name).is_dir():
            return root / name
    return None
