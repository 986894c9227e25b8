"""The design section of a task file: joints, limits, and the DH tables that are allowed."""

from __future__ import annotations

import numpy as np

from ft_manip_ros.core.design.space import COLUMNS, FAMILIES, design_space
from ft_manip_ros.core.goal import DesignSpec
from ft_manip_ros.core.strict_yaml import Fields, located


def read_design(entry: Fields) -> DesignSpec:
    """Read what the designer has to design.

    Raises
    ------
    InputError
        Naming the key, and what would be valid.
    """
    dof = entry.integer('dof')
    order = entry.integer('order', 1)
    lower, upper = _joint_limits(entry)
    bounds: dict[str, tuple[float, float]] = {}
    fixed: dict[str, float] = {}
    ranges, values = entry.mapping('bounds'), entry.mapping('fixed')
    for column in COLUMNS:
        numbered = [f'{column}_{i + 1}' for i in range(dof)]
        for name in (column, *numbered):
            pair = _pair(ranges, name) if ranges is not None else None
            if pair is not None:
                bounds[name] = pair
        for name in numbered:
            value = _value(values, name) if values is not None else None
            if value is not None:
                fixed[name] = value
    for nested in (ranges, values):
        if nested is not None:
            nested.finish()
    alpha_step = entry.angle('alpha_step', 0.0)
    family = entry.text('family', FAMILIES[0])
    max_length = entry.number('max_length', np.inf)
    entry.finish()
    assert alpha_step is not None
    with located(entry.where):
        spec = DesignSpec(dof, order, lower, upper, bounds, fixed, alpha_step, family, max_length)
        # The space is built again by the search; here it only says what is wrong with it.
        design_space(
            dof, 1.0, bounds=bounds, fixed=fixed, alpha_step=alpha_step, family=family,
            max_length=max_length,
        )  # fmt: skip
    return spec


def _joint_limits(
    entry: Fields,
) -> tuple[float | tuple[float, ...], float | tuple[float, ...]]:
    """Read one pair for all joints, or a list with a pair for each."""
    for key, scale in (('joint_limits', 1.0), ('joint_limits_deg', np.pi / 180.0)):
        if entry.is_table(key):
            if entry.has('joint_limits') and entry.has('joint_limits_deg'):
                break
            pairs = scale * np.array(entry.pairs(key))
            return tuple(pairs[:, 0].tolist()), tuple(pairs[:, 1].tolist())
    lower, upper = entry.angles('joint_limits', 2) or (-np.pi, np.pi)
    return lower, upper


def _pair(entry: Fields, name: str) -> tuple[float, float] | None:
    if name.startswith('alpha'):
        pair = entry.angles(name, 2)
    else:
        pair = entry.numbers(name, 2) if entry.has(name) else None
    return None if pair is None else (pair[0], pair[1])


def _value(entry: Fields, name: str) -> float | None:
    if name.startswith('alpha'):
        return entry.angle(name)
    return entry.number(name) if entry.has(name) else None
