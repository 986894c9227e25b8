"""Things around the arm that it must not touch, from a YAML file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import coal
import numpy as np
import yaml

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import rotation_from_quaternion

# Numbers that each shape is given by, all in m.
SHAPES = {'box': 3, 'sphere': 1, 'cylinder': 2, 'capsule': 2}


@dataclass(frozen=True, eq=False)
class Obstacle:
    """One convex body, in the frame of the arm's base.

    Attributes
    ----------
    shape, size
        ``box``: the three edges; ``sphere``: radius; ``cylinder`` and ``capsule``: radius and
        length along z (m).
    position : ndarray, shape (3,)
        Of its centre (m).
    rotation : ndarray, shape (3, 3)
    """

    name: str
    shape: str
    size: tuple[float, ...]
    position: Array
    rotation: Array

    def geometry(self) -> coal.ShapeBase:
        """Return the shape for the collision library."""
        kinds = {
            'box': coal.Box,
            'sphere': coal.Sphere,
            'cylinder': coal.Cylinder,
            'capsule': coal.Capsule,
        }
        return kinds[self.shape](*self.size)


def load_obstacles(path: str | Path) -> tuple[Obstacle, ...]:
    """Read obstacles from a YAML file.

    The file is a list under the key ``obstacles``; each entry has a ``position`` (m), one of
    ``box: [x, y, z]``, ``sphere: r``, ``cylinder: [r, length]`` or ``capsule: [r, length]``, and
    if wanted a ``name`` and an ``orientation: [qx, qy, qz, qw]``.

    Raises
    ------
    InputError
        Naming the entry and the field.
    """
    try:
        data = yaml.safe_load(Path(path).expanduser().read_text(encoding='utf-8'))
    except OSError as error:
        raise InputError(str(path), f'cannot be read: {error.strerror}') from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(str(path), f'is not YAML: {error}') from error
    entries = data.get('obstacles') if isinstance(data, dict) else None
    if not isinstance(entries, list):
        raise InputError(f'{path}: obstacles', 'is missing; a list of obstacles is needed')
    return tuple(_obstacle(entry, f'{path}: obstacles[{k}]') for k, entry in enumerate(entries))


def _obstacle(entry: object, where: str) -> Obstacle:
    if not isinstance(entry, dict):
        raise InputError(where, 'is not a mapping with position and one of ' + ', '.join(SHAPES))
    unknown = set(entry) - {*SHAPES, 'name', 'position', 'orientation'}
    shapes = [key for key in SHAPES if key in entry]
    if unknown or len(shapes) != 1:
        raise InputError(
            where,
            f'has the keys {", ".join(map(str, entry))}; it needs position and exactly one of '
            f'{", ".join(SHAPES)}, and may have name and orientation',
        )
    shape = shapes[0]
    size = _numbers(entry[shape], SHAPES[shape], f'{where}.{shape}')
    if np.any(size <= 0.0):
        raise InputError(f'{where}.{shape}', 'must be above 0')
    rotation = np.eye(3)
    if 'orientation' in entry:
        quaternion = _numbers(entry['orientation'], 4, f'{where}.orientation')
        rotation = rotation_from_quaternion(quaternion, f'{where}.orientation')
    return Obstacle(
        str(entry.get('name', where.rpartition(': ')[2])),
        shape,
        tuple(float(x) for x in size),
        _numbers(entry.get('position'), 3, f'{where}.position'),
        rotation,
    )


def _numbers(value: object, count: int, where: str) -> Array:
    try:
        numbers = np.atleast_1d(np.array(value, dtype=float))
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        raise InputError(where, f'must be {count} finite number{"s" if count > 1 else ""}')
    return numbers
