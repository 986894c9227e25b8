"""A design as markers: the arm at each goal of its task, the way of its tool, goals, volumes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.goal import Goal, Task
from ft_manip_ros.core.ik import solve_ik
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.region import Sphere

_LINE_WIDTH = 0.015  # m
_PATH_WIDTH = 0.006  # m
_GOAL_SIZE = 0.04  # m
# Points of the tool's way from one goal to the next.
_PATH_POINTS = 40
_ARM_COLORS = ((0.15, 0.35, 0.75), (0.85, 0.45, 0.1), (0.2, 0.6, 0.3), (0.6, 0.25, 0.6))
_GOAL_COLOR = ColorRGBA(r=0.1, g=0.1, b=0.1, a=1.0)
_PATH_COLOR = ColorRGBA(r=0.75, g=0.1, b=0.2, a=0.9)
_REGION_COLOR = ColorRGBA(r=0.3, g=0.3, b=0.3, a=0.25)


def design_markers(chain: SerialChain, task: Task, header: Header) -> MarkerArray:
    """Old markers away, then those of a design.

    Namespaces: ``arm``, a line along the arm at every goal it reaches, numbered as the goals;
    ``tool_path``, the way of the tool where all joints move evenly from each of these postures
    to the next; ``goals``; ``regions``, the volumes to be reached whole, numbered as the goals.
    """
    markers = [Marker(header=header, action=Marker.DELETEALL)]
    postures: list[Array] = []
    for i, goal in enumerate(task.goals):
        # From the posture before, so that the way between them is short.
        found = solve_ik(chain, goal, start=postures[-1] if postures else None)
        if not found.converged:
            continue
        postures.append(found.q)
        red, green, blue = _ARM_COLORS[i % len(_ARM_COLORS)]
        color = ColorRGBA(r=red, g=green, b=blue, a=0.8)
        places = joint_positions(chain, found.q)
        markers.append(_line(header, 'arm', i, _LINE_WIDTH, color, places))
    if len(postures) > 1:
        way = tool_path(chain, postures)
        markers.append(_line(header, 'tool_path', 0, _PATH_WIDTH, _PATH_COLOR, way))
    goals = Marker(header=header, ns='goals', type=Marker.SPHERE_LIST, action=Marker.ADD)
    goals.pose.orientation.w = 1.0
    goals.scale = Vector3(x=_GOAL_SIZE, y=_GOAL_SIZE, z=_GOAL_SIZE)
    goals.color = _GOAL_COLOR
    goals.points = [_point(goal.position) for goal in task.goals]
    markers.append(goals)
    markers += [
        _region(header, i, goal) for i, goal in enumerate(task.goals) if goal.region is not None
    ]
    return MarkerArray(markers=markers)


def tool_path(chain: SerialChain, postures: list[Array]) -> Array:
    """Positions (M, 3), m, of the tool where joints move evenly through ``postures``."""
    shares = np.linspace(0.0, 1.0, _PATH_POINTS, endpoint=False)[:, None]
    steps = []
    for a, b in pairwise(postures):
        turn = b - a
        # Joints without limits take the short way round.
        steps.append(
            a
            + shares
            * np.where(chain.arrays.wraps, np.remainder(turn + np.pi, 2.0 * np.pi) - np.pi, turn)
        )
    return np.array([fk(chain, q)[1] for q in np.concatenate([*steps, postures[-1:]])])


def joint_positions(chain: SerialChain, q: Array) -> Array:
    """Base, joint origins and tool at posture ``q``, shape (n+2, 3), m."""
    places = [np.zeros(3)]
    rotation, position = np.eye(3), np.zeros(3)
    for i, joint in enumerate(chain.joints):
        position = position + rotation @ chain.translations[i]
        rotation = rotation @ chain.rotations[i]
        places.append(position)
        if joint.prismatic:
            position = position + q[i] * rotation[:, 2]
        else:
            c, s = np.cos(q[i]), np.sin(q[i])
            rotation = rotation @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.array([*places, fk(chain, q)[1]])


def _line(
    header: Header, namespace: str, number: int, width: float, color: ColorRGBA, places: Array
) -> Marker:
    line = Marker(
        header=header, ns=namespace, id=number, type=Marker.LINE_STRIP, action=Marker.ADD
    )
    line.pose.orientation.w = 1.0
    line.scale.x = width
    line.color = color
    line.points = [_point(place) for place in places]
    return line


def _region(header: Header, number: int, goal: Goal) -> Marker:
    assert goal.region is not None
    kind = Marker.SPHERE if isinstance(goal.region, Sphere) else Marker.CUBE
    marker = Marker(header=header, ns='regions', id=number, type=kind, action=Marker.ADD)
    marker.pose.position = _point(goal.position)
    marker.pose.orientation.w = 1.0
    x, y, z = (2.0 * goal.region.half).tolist()
    marker.scale = Vector3(x=x, y=y, z=z)
    marker.color = _REGION_COLOR
    return marker


def _point(position: Array) -> Point:
    x, y, z = (float(value) for value in position)
    return Point(x=x, y=y, z=z)
