"""Arm files: DH tables in `config/arms/*.yaml`, read strictly and written back."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import yaml

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.config_files import find_config
from ft_manip_ros.core.dh import DhTable
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.joint import DEFAULT_ACCELERATION, DEFAULT_VELOCITY, Joint
from ft_manip_ros.core.strict_yaml import Fields, located, read_fields
from ft_manip_ros.core.whole_file import write_whole

CONVENTION = 'standard_dh'


def load_arm(
    path_or_name: str | os.PathLike[str], *, base: str | None = None, tip: str | None = None
) -> SerialChain:
    """Return the chain of an arm file or a URDF.

    Parameters
    ----------
    path_or_name
        A name from ``config/arms``, the path of a YAML arm file, the path or ``package://`` URL
        of a URDF, or the URDF's own text.
    base, tip
        Link names, only for a URDF; None or empty means its root and its only leaf.

    Raises
    ------
    InputError
        Naming the file and the line or field, and what would be valid.
    """
    text = os.fspath(path_or_name)
    if text.lstrip().startswith('<'):
        return _urdf(text, base, tip)
    path = find_config('arms', path_or_name)
    if path.suffix in ('.urdf', '.xml'):
        return _urdf(str(path), base, tip)
    if path.suffix == '.xacro':
        raise InputError(str(path), 'is xacro; expand it first: xacro FILE > arm.urdf')
    for key, link in (('base', base), ('tip', tip)):
        if link:
            raise InputError(key, f'is {link!r}, but {path} is a DH table: only URDFs have links')
    return read_dh(path).chain()


def load_dh(path_or_name: str | os.PathLike[str]) -> DhTable:
    """Return the DH table of an arm file, by path or by name in ``config/arms``.

    Raises
    ------
    InputError
        As `load_arm`; also for a URDF, which has no DH table.
    """
    path = find_config('arms', path_or_name)
    if path.suffix in ('.urdf', '.xml', '.xacro'):
        raise InputError(str(path), 'is a URDF; a DH table (a YAML arm file) is needed here')
    return read_dh(path)


def read_dh(path: Path) -> DhTable:
    """Return the DH table in one YAML file."""
    fields = read_fields(path)
    name = fields.text('name')
    fields.text('description', ' ')
    convention = fields.text('convention', CONVENTION)
    if convention != CONVENTION:
        raise InputError(
            fields.at('convention'), f'is {convention!r}; only {CONVENTION!r} is known'
        )
    entries = fields.mappings('joints')
    rows = [_row(entry, last=i == len(entries) - 1) for i, entry in enumerate(entries)]
    fields.finish()
    joints = tuple(joint for joint, _ in rows)
    names = [joint.name for joint in joints]
    for i, joint in enumerate(names):
        if joint in names[:i]:
            raise InputError(entries[i].at('name'), f'{joint!r} names two joints')
    d, a, alpha, offset = np.array([values for _, values in rows]).T
    with located(fields.where):
        return DhTable(name, joints, d, a, alpha, offset)


def save_dh(table: DhTable, path: str | os.PathLike[str]) -> None:
    """Write a DH table as an arm file that `load_dh` reads back to the same numbers.

    The file appears whole or not at all.

    Raises
    ------
    InputError
        If the folder is missing or cannot be written.
    """
    rows = []
    for i, joint in enumerate(table.joints):
        row: dict[str, str | float] = {'name': joint.name}
        if joint.prismatic:
            row['type'] = 'prismatic'
        for key in ('d', 'a', 'alpha'):
            row[key] = float(getattr(table, key)[i])
        if table.offset[i] != 0.0:
            row['offset'] = float(table.offset[i])
        for key in ('lower', 'upper', 'operating_lower', 'operating_upper'):
            if getattr(joint, key) is not None:
                row[key] = float(getattr(joint, key))
        row['velocity'] = float(joint.velocity)
        row['acceleration'] = float(joint.acceleration)
        rows.append(row)
    content = {'name': table.name, 'convention': CONVENTION, 'joints': rows}
    write_whole(path, yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=400))


def _row(entry: Fields, last: bool) -> tuple[Joint, tuple[float, float, float, float]]:
    """One joint and its (d, a, alpha, offset)."""
    name = entry.text('name')
    kind = entry.text('type', 'revolute')
    if kind not in ('revolute', 'prismatic'):
        raise InputError(entry.at('type'), f'is {kind!r}; valid are revolute, prismatic')
    sliding = kind == 'prismatic'
    d, a = entry.number('d'), entry.number('a')
    alpha = entry.angle('alpha', 0.0 if last else None)
    if alpha is None:
        raise InputError(
            entry.at('alpha'), 'is missing; give alpha (rad) or alpha_deg (only the last may not)'
        )
    offset = entry.angle('offset', 0.0)
    assert offset is not None
    limits = {
        key: _position(entry, key, sliding)
        for key in ('lower', 'upper', 'operating_lower', 'operating_upper')
    }
    velocity = _position(entry, 'velocity', sliding)
    acceleration = _position(entry, 'acceleration', sliding)
    entry.finish()
    lower, upper = limits['lower'], limits['upper']
    if (lower is None) != (upper is None):
        missing = 'upper' if upper is None else 'lower'
        raise InputError(
            entry.at(missing), 'is missing; give both limits, or none for a full turn'
        )
    if lower is None or upper is None:
        if sliding:
            raise InputError(entry.at('lower'), 'is missing; a prismatic joint needs limits (m)')
        lower, upper = -np.pi, np.pi
    with located(entry.where):
        joint = Joint(
            name,
            lower,
            upper,
            limits['operating_lower'],
            limits['operating_upper'],
            DEFAULT_VELOCITY if velocity is None else velocity,
            DEFAULT_ACCELERATION if acceleration is None else acceleration,
            sliding,
        )
    return joint, (d, a, alpha, offset)


def _position(entry: Fields, key: str, sliding: bool) -> float | None:
    """A quantity of the joint's own kind: rad (or degrees under ``_deg``), or m if it slides."""
    if sliding:
        if entry.has(f'{key}_deg'):
            raise InputError(
                entry.at(f'{key}_deg'), f'is an angle, but the joint is prismatic: {key} in m'
            )
        return entry.number(key) if entry.has(key) else None
    return entry.angle(key)


def _urdf(text_or_path: str, base: str | None, tip: str | None) -> SerialChain:
    # Imported late: Pinocchio is only needed for URDFs and takes long to load.
    from ft_manip_ros.core.urdf import chain_from_urdf

    return chain_from_urdf(text_or_path, base or None, tip or None)
