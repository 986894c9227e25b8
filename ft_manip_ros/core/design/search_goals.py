"""The points that a search works on: a task's goals, and points around them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.design.dh_kernels import AXIS, POSE, POSITION, Goals, IntArray
from ft_manip_ros.core.goal import Goal, Task
from ft_manip_ros.core.region import Sphere

# Corners of a tetrahedron on the unit sphere, shape (4, 3).
TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)


def with_balls(task: Task, radius: float) -> Task:
    """Return the task with a ball of ``radius`` (m) around every goal that has no region."""
    if radius <= 0.0:
        return task
    return replace(
        task,
        goals=tuple(
            goal if goal.region is not None else replace(goal, region=Sphere(radius))
            for goal in task.goals
        ),
    )


def pack_task(task: Task) -> tuple[Goals, IntArray]:
    """Return a task's goals as the kernels read them, then points on their regions' surfaces.

    Returns
    -------
    goals : Goals
        P points.
    owners : ndarray, shape (P,)
        The goal of the task that each point belongs to; the first are the goals themselves.
    """
    goals = pack_goals(task.goals)
    owners = list(range(len(task.goals)))
    for i, goal in enumerate(task.goals):
        if goal.region is not None:
            surface = goal.position + goal.region.surface()
            goals = with_positions(goals, i, surface)
            owners += [i] * len(surface)
    return goals, np.array(owners, dtype=np.int64)


def pack_goals(goals: tuple[Goal, ...]) -> Goals:
    """Return goals as the kernels read them."""
    modes = [
        POSITION if goal.orientation is None else AXIS if goal.free_axis else POSE
        for goal in goals
    ]
    return Goals(
        np.array([goal.position for goal in goals], dtype=float),
        np.array([np.eye(3) if g.orientation is None else g.orientation for g in goals]),
        np.array(modes, dtype=np.int64),
    )


def with_positions(goals: Goals, like: int, positions: Array) -> Goals:
    """Return ``goals`` and then ``positions`` (M, 3), m, asked for as goal ``like`` is."""
    count = len(positions)
    return Goals(
        np.ascontiguousarray(np.concatenate([goals.positions, positions])),
        np.ascontiguousarray(
            np.concatenate([goals.orientations, np.tile(goals.orientations[like], (count, 1, 1))])
        ),
        np.concatenate([goals.modes, np.full(count, goals.modes[like])]),
    )


def guarded_goals(task: Task, goals: Goals, radius: float) -> Goals:
    """Return ``goals`` (of `pack_task`), then points that give them room.

    Around a goal they are the corners of a tetrahedron of ``radius`` (m), around a region the
    points of its surface moved outwards by as much.
    """
    if radius <= 0.0:
        return goals
    for corner in TETRAHEDRON:
        for i, goal in enumerate(task.goals):
            if goal.region is None:
                goals = with_positions(goals, i, goal.position[None] + radius * corner)
    for i, goal in enumerate(task.goals):
        if goal.region is not None:
            surface = goal.region.surface()
            outwards = surface / np.linalg.norm(surface, axis=1, keepdims=True)
            goals = with_positions(goals, i, goal.position + surface + radius * outwards)
    return goals
