"""URDFs in, through Pinocchio: the serial chain between two links of a robot description."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio

from ft_manip_ros.core.chain import (
    DEFAULT_ACCELERATION,
    DEFAULT_VELOCITY,
    Array,
    Joint,
    SerialChain,
    joint_motion,
)
from ft_manip_ros.core.errors import InputError


def chain_from_urdf(
    text_or_path: str | os.PathLike[str], base: str | None = None, tip: str | None = None
) -> SerialChain:
    """Return the serial chain from link ``base`` to link ``tip`` of a URDF.

    Meshes are not read and need not exist. Joints off the way are left out; a joint whose two
    limits are equal counts as fixed. Soft limits of a ``safety_controller`` become operating
    limits. URDFs name no acceleration (unless as the ``acceleration`` of a ``limit``), and a
    velocity of 0 means none is known: then the defaults of `Joint` hold.

    Parameters
    ----------
    text_or_path
        The XML itself or the path of a file.
    base, tip
        Link names; the root link and the only end link by default.

    Raises
    ------
    InputError
        If the file or the XML cannot be read, a link is unknown, the tip is not below the base,
        several links could be the tip, or the way has a joint with other than one degree of
        freedom or one that mimics another.
    """
    text, where = _read(text_or_path)
    root = _parse(text, where)
    where = f'{where} ({root.get("name", "robot")})' if where == 'URDF' else where
    base = base or _root_link(root, where)
    tip = tip or _only_end_link(root, where)
    links = [link.get('name', '') for link in root.findall('link')]
    for key, link in (('base', base), ('tip', tip)):
        if link not in links:
            raise InputError(f'{where}: {key}', f'{link!r} is not a link; links: {_some(links)}')
    details = {joint.get('name', ''): joint for joint in root.findall('joint')}
    model = _build(text, where)
    return _extract(model, details, root.get('name', 'robot'), base, tip, where)


@dataclass
class _Placements:
    """Constant placements as they come together along the way."""

    rotations: list[Array]
    translations: list[Array]

    def append(self, rotation: Array, translation: Array) -> None:
        """Continue the last placement by another one."""
        self.translations[-1] = self.translations[-1] + self.rotations[-1] @ translation
        self.rotations[-1] = self.rotations[-1] @ rotation

    def next_joint(self) -> None:
        """Begin the placement after a joint."""
        self.rotations.append(np.eye(3))
        self.translations.append(np.zeros(3))


def _extract(
    model: pinocchio.Model,
    details: dict[str, ElementTree.Element],
    name: str,
    base: str,
    tip: str,
    where: str,
) -> SerialChain:
    base_frame = model.frames[model.getFrameId(base, pinocchio.FrameType.BODY)]
    tip_frame = model.frames[model.getFrameId(tip, pinocchio.FrameType.BODY)]
    way = [tip_frame.parentJoint]
    while way[-1] != base_frame.parentJoint:
        if way[-1] == 0:
            raise InputError(f'{where}: tip', f'link {tip!r} is not below the base {base!r}')
        way.append(model.parents[way[-1]])
    way = way[-2::-1]
    placements = _Placements([np.eye(3)], [np.zeros(3)])
    start = base_frame.placement.inverse()
    placements.append(start.rotation, start.translation)
    joints: list[Joint] = []
    for j in way:
        placement = model.jointPlacements[j]
        placements.append(placement.rotation, placement.translation)
        detail = details[model.names[j]]
        joint_where = f'{where}: joint {model.names[j]!r}'
        if detail.find('mimic') is not None:
            raise InputError(
                joint_where, 'mimics another joint; choose a tip before it: it cannot fail alone'
            )
        axis, sliding = _axis(model.joints[j], joint_where)
        align = _turn_z_to(axis)
        placements.append(align, np.zeros(3))
        joint = _joint(model, j, detail, sliding, joint_where)
        if isinstance(joint, float):
            placements.append(*joint_motion(sliding, joint))
        else:
            joints.append(joint)
            placements.next_joint()
        placements.append(align.T, np.zeros(3))
    placements.append(tip_frame.placement.rotation, tip_frame.placement.translation)
    if not joints:
        raise InputError(f'{where}: base, tip', f'no joint moves between {base!r} and {tip!r}')
    return SerialChain(
        name, tuple(joints), np.array(placements.rotations), np.array(placements.translations)
    )


def _axis(joint: pinocchio.JointModel, where: str) -> tuple[Array, bool]:
    """Unit axis of a one-degree-of-freedom joint in its own frame, and whether it slides."""
    if joint.nv != 1:
        raise InputError(
            where, f'has {joint.nv} degrees of freedom; only revolute, continuous and prismatic'
        )
    data = joint.createData()
    # A continuous joint's coordinate is a point on the circle, so zero is no position of it.
    joint.calc(data, np.array([1.0, 0.0]) if joint.nq == 2 else np.zeros(1))
    motion = np.asarray(data.S).ravel()
    sliding = bool(np.linalg.norm(motion[3:]) < 0.5)
    return (motion[:3] if sliding else motion[3:]), sliding


def _joint(
    model: pinocchio.Model, j: int, detail: ElementTree.Element, sliding: bool, where: str
) -> Joint | float:
    """Return the joint, or its position where its limits leave it none to move to."""
    kind = model.joints[j]
    limit = detail.find('limit')
    if kind.nq == 2:
        lower, upper = -np.pi, np.pi
    else:
        lower = float(model.lowerPositionLimit[kind.idx_q])
        upper = float(model.upperPositionLimit[kind.idx_q])
        if lower == upper:
            return lower
    velocity = float(model.velocityLimit[kind.idx_v])
    acceleration = _attribute(limit, 'acceleration', where)
    soft = detail.find('safety_controller')
    soft_lower = _attribute(soft, 'soft_lower_limit', where)
    soft_upper = _attribute(soft, 'soft_upper_limit', where)
    # Both zero is what the format gives where nothing is said.
    if not soft_lower and not soft_upper:
        soft_lower = soft_upper = None
    try:
        return Joint(
            model.names[j],
            lower,
            upper,
            # Soft limits outside the hard ones say nothing that those do not.
            None if soft_lower is None or soft_lower <= lower else soft_lower,
            None if soft_upper is None or soft_upper >= upper else soft_upper,
            velocity if np.isfinite(velocity) and velocity > 0.0 else DEFAULT_VELOCITY,
            acceleration if acceleration else DEFAULT_ACCELERATION,
            sliding,
        )
    except InputError as error:
        raise InputError(f'{where}: {error.field}', error.problem) from error


def _attribute(element: ElementTree.Element | None, key: str, where: str) -> float | None:
    text = None if element is None else element.get(key)
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = float('nan')
    if not np.isfinite(value):
        raise InputError(f'{where}: {key}', f'is {text!r}; a finite number is needed')
    return value


def _turn_z_to(axis: Array) -> Array:
    """Rotation (3, 3) whose third column is the given unit axis; the identity for z itself."""
    axis = axis / np.linalg.norm(axis)
    c = float(axis[2])
    if c > 1.0 - 1e-15:
        return np.eye(3)
    # The other two columns are free. Gram-Schmidt on the unit vector least along the axis keeps
    # an axis along x, y or -z exact.
    first = np.zeros(3)
    first[int(np.argmin(np.abs(axis)))] = 1.0
    first -= axis * (axis @ first)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(axis, first), axis])


def _read(text_or_path: str | os.PathLike[str]) -> tuple[str, str]:
    given = os.fspath(text_or_path)
    if given.lstrip().startswith('<'):
        return given, 'URDF'
    try:
        return Path(given).expanduser().read_text(encoding='utf-8'), given
    except OSError as error:
        raise InputError(given, f'cannot be read: {error.strerror}') from error
    except UnicodeDecodeError as error:
        raise InputError(given, 'is not UTF-8 text') from error


def _parse(text: str, where: str) -> ElementTree.Element:
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


def _build(text: str, where: str) -> pinocchio.Model:
    try:
        return pinocchio.buildModelFromXML(text)
    except (ValueError, RuntimeError, IndexError) as error:
        raise InputError(where, f'is not a URDF that Pinocchio can read: {error}') from error


def _root_link(root: ElementTree.Element, where: str) -> str:
    children = {element.get('link') for element in root.findall('joint/child')}
    roots = [name for link in root.findall('link') if (name := link.get('name')) not in children]
    if len(roots) != 1 or roots[0] is None:
        raise InputError(where, f'has {len(roots)} root links; a URDF has one')
    return roots[0]


def _only_end_link(root: ElementTree.Element, where: str) -> str:
    parents = {element.get('link') for element in root.findall('joint/parent')}
    ends = [
        name
        for link in root.findall('link')
        if (name := link.get('name')) is not None and name not in parents
    ]
    if len(ends) != 1:
        raise InputError(
            f'{where}: tip', f'is needed, for there are {len(ends)} end links: {_some(ends)}'
        )
    return ends[0]


def _some(names: list[str]) -> str:
    return ', '.join(names[:12]) + (f' and {len(names) - 12} more' if len(names) > 12 else '')
