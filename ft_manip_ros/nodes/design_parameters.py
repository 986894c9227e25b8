"""Parameters of the node `designer`, and what the search makes of them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from rclpy.parameter import Parameter

from ft_manip_ros.core.design.settings import METHODS, DesignSettings
from ft_manip_ros.core.design.space import FAMILIES
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import MOST_JOINTS, DesignSpec, Task
from ft_manip_ros.nodes.managed_node import ManagedNode
from ft_manip_ros.nodes.parameters import ParameterSpec

PARAMETERS = (
    ParameterSpec(
        'task',
        'paredis_eq_11',
        'The task: name of a task file in config/tasks, or its path. Its design section is the '
        'default for tasks that come as messages.',
    ),
    ParameterSpec('run_at_start', True, 'Search for the task as soon as the node is active.'),
    ParameterSpec('dof', 0, 'Number of joints; 0: as the task file says.', '', 0, MOST_JOINTS),
    ParameterSpec('order', 0, 'Joints that fail at once; 0: as the task file says.', '', 0, 8),
    ParameterSpec(
        'joint_limits',
        Parameter.Type.DOUBLE_ARRAY,
        'Lower and upper limit of every joint, or of each in turn; empty: as the task file says.',
        'rad',
    ),
    ParameterSpec('method', METHODS[0], 'How to search.', choices=METHODS),
    ParameterSpec('seed', 0, 'Seed of the search.', '', 0, 2**63 - 1),
    ParameterSpec('time_budget', 60.0, 'When the search gives up.', 's', 0.1, 604800.0),
    ParameterSpec('workers', 2, 'Threads that search side by side.', '', 1, 256),
    ParameterSpec(
        'margin',
        0.04,
        "Room kept around every goal, as a share of the farthest goal's distance.",
        '',
        0.0,
        0.5,
    ),
    ParameterSpec(
        'ball',
        0.0,
        'Radius of the ball around every goal to be reached whole, where it has no region.',
        'm',
        0.0,
        10.0,
    ),
    ParameterSpec(
        'alpha_step',
        0.0,
        'alpha is a multiple of this; 0: as the task file says, or any value.',
        'rad',
        0.0,
        3.2,
    ),
    ParameterSpec(
        'family',
        '',
        'Links free, or tied symmetrically; empty: as the task file says.',
        choices=('', *FAMILIES),
    ),
    ParameterSpec(
        'max_length',
        0.0,
        'Longest sum of link lengths; 0: as the task file says, or any.',
        'm',
        0.0,
        1e4,
    ),
    ParameterSpec(
        'certificate',
        '',
        'File for the proofs of each proved design, checked by the independent verifier before '
        'the design is announced; the next one replaces it. Empty: none.',
    ),
    ParameterSpec(
        'report',
        '',
        'PNG file for the picture of each design; the next one replaces it. Empty: none.',
    ),
    ParameterSpec('frame', 'base_link', 'Frame of everything published: the base of the arm.'),
)


def read_settings(node: ManagedNode) -> DesignSettings:
    """Search settings from the node's parameters; raises `InputError`."""
    return DesignSettings(
        method=node.param('method'),
        seed=node.param('seed'),
        time_budget=node.param('time_budget'),
        workers=node.param('workers'),
        margin=node.param('margin'),
        ball=node.param('ball'),
        alpha_step=node.param('alpha_step'),
        family=node.param('family'),
        max_length=node.param('max_length') or float('inf'),
    )


def read_files(node: ManagedNode) -> dict[str, str]:
    """Files to write, by parameter; raises `InputError` where one could not be written."""
    files = {name: node.param(name) for name in ('certificate', 'report')}
    for name, path in files.items():
        folder = os.path.dirname(path) or '.'
        if path and not os.access(folder, os.W_OK):
            raise InputError(f'parameter {name}', f'no file can be written in {folder}')
        if path and os.path.isdir(path):
            raise InputError(f'parameter {name}', f'{path} is a folder; a file is needed')
    return files


def read_specification(node: ManagedNode, task: Task) -> DesignSpec:
    """What to design: the parameters where they are given, else the task's design section.

    Raises
    ------
    InputError
        Where neither says how many joints, or the limits do not fit them.
    """
    limits = list(node.param('joint_limits'))
    dof, order = node.param('dof'), node.param('order')
    if task.design is None and not dof:
        raise InputError('parameter dof', f'is 0, and task {task.name!r} has no design section')
    base = task.design or DesignSpec(dof)
    if limits:
        base = replace(base, **joint_limits(limits, dof or base.dof, 'parameter joint_limits'))
    return replace(base, dof=dof or base.dof, order=order or base.order)


def joint_limits(values: Sequence[float], dof: int, where: str) -> dict[str, Any]:
    """Fields of a `DesignSpec` for limits that come as one list.

    Parameters
    ----------
    values
        Lower and upper limit of every joint, or of each in turn, rad.

    Raises
    ------
    InputError
        Under the name ``where``, for another number of values.
    """
    if len(values) == 2:
        return {'lower': values[0], 'upper': values[1]}
    if len(values) != 2 * dof:
        raise InputError(where, f'has {len(values)} values; {dof} joints need 2 or {2 * dof}')
    return {'dof': dof, 'lower': tuple(values[::2]), 'upper': tuple(values[1::2])}
