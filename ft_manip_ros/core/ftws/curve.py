"""Compiled curve of postures that holds the goal: each order is cancelled by a direction."""

from __future__ import annotations

import math

from ft_manip_ros.core.chain import Array, ChainArrays
from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.ftws.local_model import LocalModel
from ft_manip_ros.core.ftws.place_series import (
    Series,
    add_change,
    cross,
    first_order,
    fourth_order,
    second_order,
    third_order,
)
from ft_manip_ros.core.ftws.task_map import TaskArrays
from ft_manip_ros.core.ftws.turn_series import CURVE, carry_turn, finish_turn


@kernel
def _cancel(
    task: TaskArrays, model: LocalModel, inverse: Array, s: Series, order: int, left: Array,
    directions: Array, defects: Array,
) -> None:  # fmt: skip
    """Direction that cancels one order's coefficient, and what it leaves of it."""
    position_rows, orientation_rows = task.position_rows, task.orientation_rows
    jacobian, change, total, turn = model.jacobian, s.change, s.total, s.turn.turn
    m, n = jacobian.shape
    mp = position_rows.shape[0]
    for row in range(mp):
        left[row] = (
            position_rows[row, 0] * total[0]
            + position_rows[row, 1] * total[1]
            + position_rows[row, 2] * total[2]
        )
    for row in range(orientation_rows.shape[0]):
        value = (
            orientation_rows[row, 0] * turn[0, order, 1]
            + orientation_rows[row, 1] * turn[0, order, 2]
            + orientation_rows[row, 2] * turn[0, order, 3]
        )
        left[mp + row] = 2.0 * task.length * value
    if order > 1:
        for i in range(n):
            value = 0.0
            for a in range(m):
                value -= inverse[i, a] * left[a]
            directions[order - 1, i] = change[i, order] = value
    square = 0.0
    for a in range(m):
        value = left[a]
        for i in range(n):
            value += jacobian[a, i] * change[i, order]
        square += value * value
    defects[order - 1] = math.sqrt(square)


@kernel
def follow(
    chain: ChainArrays,
    task: TaskArrays,
    model: LocalModel,
    inverse: Array,
    directions: Array,
    defects: Array,
    left: Array,
    s: Series,
) -> None:
    """Directions that cancel the orders 2 to CURVE along the tangent, at an evaluated posture.

    Parameters
    ----------
    inverse : shape (n, m)
        Right inverse of the free joints' Jacobian.
    directions : shape (>= CURVE, n), in and out
        The tangent in row 0; rows 1 to CURVE - 1 are written.
    defects : shape (>= CURVE,), out
        What the computed directions leave of each order's coefficient, as a norm.
    left : shape (m,)
        Scratch.
    s : Series, out
        All series; along the curve ``F = r0 + O(CURVE + 1)`` but for the defects.
    """
    axes, linear, prismatic, change = model.axes, model.linear, chain.prismatic, s.change
    oriented = task.orientation_rows.shape[0] > 0
    for i in range(linear.shape[0]):
        change[i, 1] = directions[0, i]
        change[i, 2] = change[i, 3] = change[i, 4] = 0.0
    if oriented:
        finish_turn(chain, model, change, s.turn, 0)
    for order in range(1, CURVE + 1):
        if order == 1:
            first_order(model, s)
        elif order == 2:
            second_order(prismatic, s)
        elif order == 3:
            third_order(prismatic, linear, s)
        else:
            fourth_order(prismatic, linear, s)
        if oriented:
            carry_turn(chain, model, change, s.turn, order)
        _cancel(task, model, inverse, s, order, left, directions, defects)
        if order == 2:
            add_change(linear, change, 2, s.second)
            cross(axes, s.second, s.crossed, 9)
        elif order == 3:
            add_change(linear, change, 3, s.third)
            cross(axes, s.third, s.crossed, 15)
        if oriented:
            finish_turn(chain, model, change, s.turn, order)
