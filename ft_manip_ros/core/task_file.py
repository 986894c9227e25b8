"""Task files: the goals of `config/tasks/*.yaml` and what the designer may need."""

from __future__ import annotations

import os

import numpy as np

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.config_files import find_config
from ft_manip_ros.core.design_section import read_design
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import (
    DEFAULT_ORIENTATION_TOLERANCE,
    DEFAULT_POSITION_TOLERANCE,
    Goal,
    Task,
    rotation_from_quaternion,
)
from ft_manip_ros.core.region import Box, Region, Sphere
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
    regions = fields.mappings('regions') if fields.has('regions') else []
    points = fields.mappings('goals') if fields.has('goals') or not regions else []
    goals = tuple(_goal(entry, i) for i, entry in enumerate(points))
    goals += tuple(_region(entry, i) for i, entry in enumerate(regions))
    design = fields.mapping('design')
    spec = None if design is None else read_design(design)
    fields.finish()
    with located(fields.where):
        return Task(name, goals, spec)


def _goal(entry: Fields, index: int) -> Goal:
    position = np.array(entry.numbers('position', 3))
    orientation, free_axis = _orientation(entry)
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


def _region(entry: Fields, index: int) -> Goal:
    """Read a volume of points: a goal at its centre that stands for all of it."""
    name = entry.text('id', f'region_{index + 1}')
    box, sphere = entry.mapping('box'), entry.mapping('sphere')
    if (box is None) == (sphere is None):
        raise InputError(
            entry.where, 'needs one of box: {center, size} and sphere: {center, radius}'
        )
    shape = box or sphere
    assert shape is not None
    center = np.array(shape.numbers('center', 3))
    region: Region
    with located(shape.where):
        if box is not None:
            x, y, z = box.numbers('size', 3)
            region = Box((x, y, z))
        else:
            region = Sphere(shape.number('radius'))
    shape.finish()
    orientation, free_axis = _orientation(entry)
    entry.finish()
    with located(entry.where):
        return Goal(center, orientation, free_axis, id=name, region=region)


def _orientation(entry: Fields) -> tuple[Array | None, bool]:
    orientation = None
    if entry.has('orientation'):
        orientation = rotation_from_quaternion(
            entry.numbers('orientation', 4), entry.at('orientation')
        )
    return orientation, entry.flag('free_axis', False)
