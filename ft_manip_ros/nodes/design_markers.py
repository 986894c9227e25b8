"""A design as markers: the arm at each goal of its task, and the goals."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import Point, Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.goal import Task
from ft_manip_ros.core.ik import solve_ik
from ft_manip_ros.core.kinematics import fk

_LINE_WIDTH = 0.015  # m
_GOAL_SIZE = 0.04  # m
_ARM_COLORS = ((0.15, 0.35, 0.75), (0.85, 0.45, 0.1), (0.2, 0.6, 0.3), (0.6, 0.25, 0.6))
_GOAL_COLOR = ColorRGBA(r=0.1, g=0.1, b=0.1, a=1.0)


def design_markers(chain: SerialChain, task: Task, header: Header) -> MarkerArray:
    """Old markers away, then a line along the arm at every goal it reaches, and the goals."""
    markers = [Marker(header=header, action=Marker.DELETEALL)]
    for i, goal in enumerate(task.goals):
        found = solve_ik(chain, goal)
        if not found.converged:
            continue
        red, green, blue = _ARM_COLORS[i % len(_ARM_COLORS)]
        line = Marker(header=header, ns='arm', id=i, type=Marker.LINE_STRIP, action=Marker.ADD)
        line.pose.orientation.w = 1.0
        line.scale.x = _LINE_WIDTH
        line.color = ColorRGBA(r=red, g=green, b=blue, a=0.8)
        line.points = [_point(p) for p in joint_positions(chain, found.q)]
        markers.append(line)
    goals = Marker(header=header, ns='goals', type=Marker.SPHERE_LIST, action=Marker.ADD)
    goals.pose.orientation.w = 1.0
    goals.scale = Vector3(x=_GOAL_SIZE, y=_GOAL_SIZE, z=_GOAL_SIZE)
    goals.color = _GOAL_COLOR
    goals.points = [_point(goal.position) for goal in task.goals]
    return MarkerArray(markers=[*markers, goals])


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


def _point(position: Array) -> Point:
    x, y, z = (float(value) for value in position)
    return Point(x=x, y=y, z=z)
