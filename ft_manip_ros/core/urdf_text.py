"""The text of a URDF as a tree of elements, and its links."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from ft_manip_ros.core.errors import InputError


def read_text(text_or_path: str | os.PathLike[str]) -> tuple[str, str]:
    """Return the XML text, and what to call it in a message."""
    given = os.fspath(text_or_path)
    if given.lstrip().startswith('<'):
        return given, 'URDF'
    try:
        return Path(given).expanduser().read_text(encoding='utf-8'), given
    except OSError as error:
        raise InputError(given, f'cannot be read: {error.strerror}') from error
    except UnicodeDecodeError as error:
        raise InputError(given, 'is not UTF-8 text') from error


def parse(text: str, where: str) -> ElementTree.Element:
    """Return the root element of a robot description."""
    try:
        # Bytes, because text with an encoding declaration is refused.
        root = ElementTree.fromstring(text.strip().encode('utf-8'))
    except ElementTree.ParseError as error:
        line, column = error.position
        raise InputError(f'{where}, line {line}', f'is not XML (column {column})') from error
    if root.tag != 'robot':
        raise InputError(where, f'has <{root.tag}> at its root; a URDF has <robot>')
    if 'xacro' in text and any('xacro' in element.tag for element in root.iter()):
        raise InputError(where, 'is xacro; expand it first: xacro FILE > arm.urdf')
    return root


def root_link(root: ElementTree.Element, where: str) -> str:
    """Name of the link that no joint leads to."""
    children = {element.get('link') for element in root.findall('joint/child')}
    roots = [name for link in root.findall('link') if (name := link.get('name')) not in children]
    if len(roots) != 1 or roots[0] is None:
        raise InputError(where, f'has {len(roots)} root links; a URDF has one')
    return roots[0]


def only_end_link(root: ElementTree.Element, where: str) -> str:
    """Name of the link that no joint leads on from; refused where there are several."""
    parents = {element.get('link') for element in root.findall('joint/parent')}
    ends = [
        name
        for link in root.findall('link')
        if (name := link.get('name')) is not None and name not in parents
    ]
    if len(ends) != 1:
        raise InputError(
            f'{where}: tip', f'is needed, for there are {len(ends)} end links: {some(ends)}'
        )
    return ends[0]


def some(names: list[str]) -> str:
    """Return names for a message, the first dozen of them."""
    return ', '.join(names[:12]) + (f' and {len(names) - 12} more' if len(names) > 12 else '')
