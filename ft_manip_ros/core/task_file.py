"""Task files: the goals of `config/tasks/*.yaml` and what the designer may need."""

from __future__ import annotations

import os

import numpy as np

from ft_manip_ros.core.config_files import find_config
from ft_manip_ros.core.goal import (
    DEFAULT_ORIENTATION_TOLERANCE,
    DEFAULT_POSITION_TOLERANCE,
    DesignSpec,
    Goal,
    Task,
    rotation_from_quaternion,
)
from ft_manip_ros.core.strict_yaml import Fields, located, read_fields


def load_task(path_or_name: str | os.PathLike[str]) -> Task:
    """Read a task by path or by its name in ``config/tasks``.

    Raises
    ------
    InputError
        Naming the file and the line or field, and what would be valid.
    """
    fields = read_fields(find_config('tasks', path_or_name))
    name = fields.text('name')
    fields.text('description', ' ')
    goals = tuple(_goal(entry, i) for i, entry in enumerate(fields.mappings('goals')))
    design = fields.mapping('design')
    spec = None if design is None else _design(design)
    fields.finish()
    with located(fields.where):
        return Task(name, goals, spec)


def _goal(entry: Fields, index: int) -> Goal:
    position = np.array(entry.numbers('position', 3))
    orientation = None
    if entry.has('orientation'):
        orientation = rotation_from_quaternion(
            entry.numbers('orientation', 4), entry.at('orientation')
        )
    free_axis = entry.flag('free_axis', False)
    position_tolerance = entry.number('position_tolerance', DEFAULT_POSITION_TOLERANCE)
    orientation_tolerance = entry.angle('orientation_tolerance', DEFAULT_ORIENTATION_TOLERANCE)
    name = entry.text('id', f'goal_{index + 1}')
    straight_line = entry.flag('straight_line', False)
    entry.finish()
    assert orientation_tolerance is not None
    with located(entry.where):
        return Goal(
            position,
            orientation,
            free_axis,
            position_tolerance,
            orientation_tolerance,
            name,
            straight_line,
        )


def _design(entry: Fields) -> DesignSpec:
    dof = entry.integer('dof')
    order = entry.integer('order', 1)
    lower, upper = entry.angles('joint_limits', 2) or (-np.pi, np.pi)
    limits = entry.mapping('bounds')
    bounds: dict[str, tuple[float, float]] | None = None
    if limits is not None:
        bounds = {}
        for key in ('d', 'a'):
            if limits.has(key):
                lo, hi = limits.numbers(key, 2)
                bounds[key] = (lo, hi)
        alpha = limits.angles('alpha', 2)
        if alpha is not None:
            bounds['alpha'] = (alpha[0], alpha[1])
        limits.finish()
    entry.finish()
    with located(entry.where):
        return DesignSpec(dof, order, lower, upper, bounds)
