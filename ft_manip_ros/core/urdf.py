"""URDFs in, through Pinocchio: the serial chain between two links of a robot description."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

import numpy as np
import pinocchio

from ft_manip_ros.core.chain import Array, SerialChain, joint_motion
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.joint import DEFAULT_ACCELERATION, DEFAULT_VELOCITY, Axis, Joint
from ft_manip_ros.core.urdf_mimic import followed, tightened
from ft_manip_ros.core.urdf_text import only_end_link, parse, read_text, root_link, some


def chain_from_urdf(
    text_or_path: str | os.PathLike[str], base: str | None = None, tip: str | None = None
) -> SerialChain:
    """Return the serial chain from link ``base`` to link ``tip`` of a URDF.

    Meshes are not read and need not exist. Joints off the way are left out; a joint whose two
    limits are equal counts as fixed. Soft limits of a ``safety_controller`` become operating
    limits. URDFs name no acceleration (unless as the ``acceleration`` of a ``limit``), and a
    velocity of 0 means none is known: then the defaults of `Joint` hold.

    A joint on the way that mimics another one moves with it: the other one is the joint of the
    chain, also where it stands off the way, within limits that both keep.

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
        freedom or one that mimics what does not exist, itself, or what leaves it no range.
    """
    text, where = read_text(text_or_path)
    root = parse(text, where)
    where = f'{where} ({root.get("name", "robot")})' if where == 'URDF' else where
    base = base or root_link(root, where)
    tip = tip or only_end_link(root, where)
    links = [link.get('name', '') for link in root.findall('link')]
    for key, link in (('base', base), ('tip', tip)):
        if link not in links:
            raise InputError(f'{where}: {key}', f'{link!r} is not a link; links: {some(links)}')
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
    driven: list[Axis] = []
    for j in way:
        placement = model.jointPlacements[j]
        placements.append(placement.rotation, placement.translation)
        joint_where = f'{where}: joint {model.names[j]!r}'
        axis, sliding = _axis(model.joints[j], joint_where)
        align = _turn_z_to(axis)
        placements.append(align, np.zeros(3))
        leader, ratio, offset = followed(details, model.names[j], where)
        if offset:
            placements.append(*joint_motion(sliding, offset))
        joint = _leader(model, details, leader, where)
        if isinstance(joint, float):
            placements.append(*joint_motion(sliding, ratio * joint))
        elif ratio != 0.0:
            names = [other.name for other in joints]
            if leader not in names:
                joints.append(joint)
                names.append(leader)
            k = names.index(leader)
            driven.append(Axis(model.names[j], k, ratio, sliding, offset))
            if leader != model.names[j]:
                own = _joint(model, j, details[model.names[j]], sliding, joint_where)
                joints[k] = tightened(joints[k], own, ratio, offset, joint_where)
            placements.next_joint()
        placements.append(align.T, np.zeros(3))
    placements.append(tip_frame.placement.rotation, tip_frame.placement.translation)
    if not joints:
        raise InputError(f'{where}: base, tip', f'no joint moves between {base!r} and {tip!r}')
    alone = all(axis.name == joints[axis.joint].name for axis in driven)
    return SerialChain(
        name,
        tuple(joints),
        np.array(placements.rotations),
        np.array(placements.translations),
        driven=() if alone else tuple(driven),
    )


def _leader(
    model: pinocchio.Model, details: dict[str, ElementTree.Element], name: str, where: str
) -> Joint | float:
    """Return a joint that moves on its own, or its position where it cannot move."""
    where = f'{where}: joint {name!r}'
    if details[name].get('type') == 'fixed':
        return 0.0
    j = model.getJointId(name)
    _, sliding = _axis(model.joints[j], where)
    return _joint(model, j, details[name], sliding, where)


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


def _build(text: str, where: str) -> pinocchio.Model:
    try:
        return pinocchio.buildModelFromXML(text)
    except (ValueError, RuntimeError, IndexError) as error:
        raise InputError(where, f'is not a URDF that Pinocchio can read: {error}') from error
