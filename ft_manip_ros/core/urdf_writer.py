"""URDFs out: a chain with its limits and simple link geometry, for RViz and other planners."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.joint import Joint

BASE_LINK = 'base_link'
TOOL_LINK = 'tool'

# Radius of the drawn links as part of the arm's length, and of the drawn joints.
_LINK_RADIUS = 0.012
_JOINT_RADIUS = 0.02
# Nothing shorter is drawn (part of the arm's length).
_SHORTEST = 0.01
# URDF wants an effort limit, of which a kinematic chain knows nothing (N m or N).
_EFFORT = 100.0


def chain_to_urdf(chain: SerialChain) -> str:
    """Return a chain as a URDF from ``base_link`` over ``link_1`` ... to ``tool``.

    Joints that mimic another one are written as such. Where that other one is not between base
    and tool, it gets a link of its own beside them: name the tip ``tool`` to read it back.

    `urdf.chain_from_urdf` reads it back to the same chain: operating limits are written as soft
    limits, the acceleration as an attribute of ``limit`` (as URDF 1.2 has it). Joints of a full
    turn from -pi to pi become continuous.

    Raises
    ------
    InputError
        If a joint's name cannot stand in XML.
    """
    length = float(np.linalg.norm(chain.translations, axis=1).sum()) or 1.0
    robot = ElementTree.Element('robot', name=chain.name)
    material = ElementTree.SubElement(robot, 'material', name='link')
    ElementTree.SubElement(material, 'color', rgba='0.35 0.45 0.6 1')
    material = ElementTree.SubElement(robot, 'material', name='joint')
    ElementTree.SubElement(material, 'color', rgba='0.9 0.5 0.15 1')
    axes = chain.uncoupled.joints
    links = [BASE_LINK, *(f'link_{i + 1}' for i in range(len(axes))), TOOL_LINK]
    for i, link in enumerate(links):
        element = ElementTree.SubElement(robot, 'link', name=link)
        if 0 < i <= len(axes):
            _cylinder(element, 'joint', np.zeros(3), np.eye(3)[2], length * _JOINT_RADIUS, length)
        if i <= len(axes):
            _cylinder(element, 'link', np.zeros(3), chain.translations[i], 0.0, length)
    leaders = {joint.name: joint for joint in chain.joints}
    for i, axis in enumerate(axes):
        place = chain.rotations[i], chain.translations[i]
        element = _joint(robot, leaders.get(axis.name, axis), links[i], links[i + 1], *place)
        if axis.name not in leaders:
            driven = chain.axes[i]
            mimic = ElementTree.SubElement(element, 'mimic')
            mimic.set('joint', chain.joint_names[driven.joint])
            mimic.set('multiplier', repr(float(driven.ratio)))
    names = {axis.name for axis in axes}
    for joint in chain.joints:
        if joint.name in names:
            continue
        # Its followers are on the way, the joint itself is not.
        ElementTree.SubElement(robot, 'link', name=f'{joint.name}_link')
        _joint(robot, joint, BASE_LINK, f'{joint.name}_link', np.eye(3), np.zeros(3))
    fixed = ElementTree.SubElement(robot, 'joint', name=f'{TOOL_LINK}_mount', type='fixed')
    _ends(fixed, links[-2], TOOL_LINK, chain.rotations[-1], chain.translations[-1])
    ElementTree.indent(robot)
    text = ElementTree.tostring(robot, encoding='unicode', xml_declaration=False)
    try:
        ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise InputError(f'chain {chain.name!r}', 'has names that XML cannot hold') from error
    return f'<?xml version="1.0"?>\n{text}\n'


def _joint(
    robot: ElementTree.Element,
    joint: Joint,
    parent: str,
    child: str,
    rotation: Array,
    translation: Array,
) -> ElementTree.Element:
    turns = not joint.prismatic and joint.lower == -np.pi and joint.upper == np.pi
    kind = 'prismatic' if joint.prismatic else 'continuous' if turns else 'revolute'
    element = ElementTree.SubElement(robot, 'joint', name=joint.name, type=kind)
    _ends(element, parent, child, rotation, translation)
    ElementTree.SubElement(element, 'axis', xyz='0 0 1')
    limit = ElementTree.SubElement(element, 'limit', effort=repr(_EFFORT))
    if not turns:
        limit.set('lower', repr(float(joint.lower)))
        limit.set('upper', repr(float(joint.upper)))
    limit.set('velocity', repr(float(joint.velocity)))
    limit.set('acceleration', repr(float(joint.acceleration)))
    if joint.operating != (joint.lower, joint.upper):
        lower, upper = joint.operating
        ElementTree.SubElement(
            element,
            'safety_controller',
            soft_lower_limit=repr(float(lower)),
            soft_upper_limit=repr(float(upper)),
            k_position='1',
            k_velocity='1',
        )
    return element


def _ends(
    element: ElementTree.Element, parent: str, child: str, rotation: Array, translation: Array
) -> None:
    ElementTree.SubElement(element, 'parent', link=parent)
    ElementTree.SubElement(element, 'child', link=child)
    _origin(element, rotation, translation)


def _cylinder(
    link: ElementTree.Element,
    kind: str,
    start: Array,
    end: Array,
    fixed_length: float,
    arm_length: float,
) -> None:
    """Draw a joint (about its axis) or a link (from its joint to the next)."""
    reach = float(np.linalg.norm(end - start))
    length = 2.0 * fixed_length if kind == 'joint' else reach
    if length < _SHORTEST * arm_length:
        return
    middle = start if kind == 'joint' else 0.5 * (start + end)
    axis = (end - start) / reach
    radius = arm_length * (_JOINT_RADIUS if kind == 'joint' else _LINK_RADIUS)
    # A cylinder lies along z; turn z to the link by yaw and pitch.
    yaw, pitch = math.atan2(axis[1], axis[0]), math.atan2(math.hypot(axis[0], axis[1]), axis[2])
    for purpose in ('visual', 'collision') if kind == 'link' else ('visual',):
        shape = ElementTree.SubElement(link, purpose)
        ElementTree.SubElement(shape, 'origin', xyz=_numbers(middle), rpy=f'0 {pitch!r} {yaw!r}')
        geometry = ElementTree.SubElement(shape, 'geometry')
        ElementTree.SubElement(geometry, 'cylinder', radius=repr(radius), length=repr(length))
        if purpose == 'visual':
            ElementTree.SubElement(shape, 'material', name=kind)


def _origin(element: ElementTree.Element, rotation: Array, translation: Array) -> None:
    ElementTree.SubElement(
        element, 'origin', xyz=_numbers(translation), rpy=_numbers(_roll_pitch_yaw(rotation))
    )


def _roll_pitch_yaw(rotation: Array) -> Array:
    """Angles of Rz(yaw) Ry(pitch) Rx(roll), to full precision also near pitch = 90 degrees.

    The roll is read after yaw and pitch are undone, so that whatever rounding they got there is
    taken up by it.
    """
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    c, s = math.cos(yaw), math.sin(yaw)
    pitch = math.atan2(-rotation[2, 0], c * rotation[0, 0] + s * rotation[1, 0])
    roll = math.atan2(
        s * rotation[0, 2] - c * rotation[1, 2], c * rotation[1, 1] - s * rotation[0, 1]
    )
    return np.array([roll, pitch, yaw])


def _numbers(values: Array) -> str:
    return ' '.join(repr(float(value)) for value in values)
