"""A picture of a design: its worst RODs, a slice of its FTWS, and how the search went."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.design.candidate import DesignResult
from ft_manip_ros.core.design.dh_kernels import COLUMN, POSITION, make_work
from ft_manip_ros.core.design.frozen_sets import FrozenSets
from ft_manip_ros.core.design.inner import NEWTON
from ft_manip_ros.core.design.penalty import derivatives, penalty
from ft_manip_ros.core.design.problem import ZERO, DesignProblem
from ft_manip_ros.core.design.restarts import random_state, solve_with_restarts
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import Verdict
from ft_manip_ros.core.plot_text import plain
from ft_manip_ros.core.whole_file import write_figure

matplotlib.use('Agg')
import matplotlib.pyplot as plt

_COLORS = {
    Verdict.MEMBER: '#2a9d57',
    Verdict.NON_MEMBER: '#f2d9d9',
    Verdict.UNDECIDED: '#f0b429',
}
# Generous: a posture overlooked would be drawn as a goal out of reach.
_RESTARTS = 150


def write_report(
    path: str | os.PathLike[str],
    problem: DesignProblem,
    result: DesignResult,
    penalties: Sequence[float],
    *,
    cells: int = 21,
) -> None:
    """Write the picture as PNG, whole or not at all.

    Parameters
    ----------
    penalties
        Penalty of every accepted candidate, in order.
    cells
        Points of the slice in each direction; each is judged by the FTWS engine.
    """
    figure = plt.figure(figsize=(15, 5), constrained_layout=True)
    figure.suptitle(
        f'{plain(result.table.name)}: {"proved" if result.proved else "not proved"}, '
        f'penalty {result.penalty:.3g} after {result.iterations} tables'
    )
    _draw_arms(figure.add_subplot(1, 3, 1, projection='3d'), problem, result)
    _draw_slice(figure.add_subplot(1, 3, 2), problem, result, cells)
    _draw_penalties(figure.add_subplot(1, 3, 3), penalties)
    write_figure(path, figure, 110)


def weakest_postures(problem: DesignProblem, p: Array) -> list[tuple[int, Array, float]]:
    """Hardest ROD of each goal: the one whose penalty is largest, then nearest to singular.

    Returns
    -------
    list of (frozen set, posture (n,), penalty)
        One entry a goal.
    """
    sets: FrozenSets = problem.sets
    rows, limits, goals = problem.rows(p), problem.limits, problem.goals
    work = make_work(problem.spec.dof)
    state = random_state(np.random.default_rng(0))
    trial = np.empty(problem.spec.dof)
    found = []
    for goal in range(problem.goal_count):
        worst = (-1.0, -np.inf)
        choice = (0, np.zeros(problem.spec.dof), 0.0)
        for subset, frozen in enumerate(sets.frozen):
            free = sets.free[subset]
            for angles in _diagonal(sets, frozen):
                q = 0.5 * (limits.lower + limits.upper)
                q[frozen] = angles
                value, _ = solve_with_restarts(
                    NEWTON, rows, goals, goal, limits, free, q, ZERO, _RESTARTS,
                    state, work, trial,
                )  # fmt: skip
                penalty(rows, goals, goal, limits, free, q, work)
                derivatives(goals, goal, free, False, work)
                score = (
                    value if value > ZERO else 0.0,
                    -_smallest_stretch(problem, goal, free, work),
                )
                if score > worst:
                    worst, choice = score, (subset, q.copy(), score[0])
        found.append(choice)
    return found


def _diagonal(sets: FrozenSets, frozen: Array) -> Array:
    # For one frozen joint the whole grid; for more, the diagonal of their grids is enough to draw.
    return sets.angles[frozen].T


def _smallest_stretch(problem: DesignProblem, goal: int, free: Array, work: Array) -> float:
    m = 3 if problem.goals.modes[goal] == POSITION else 6
    return float(np.linalg.svd(work[COLUMN, :m][:, free], compute_uv=False)[-1])


def _links(problem: DesignProblem, p: Array, q: Array) -> Array:
    """Corner points of the arm, shape (2n+1, 3): along d, then along a, of every link."""
    n = problem.spec.dof
    points = [np.zeros(3)]
    rotation, origin = np.eye(3), np.zeros(3)
    for i in range(n):
        c, s = np.cos(q[i]), np.sin(q[i])
        rotation = rotation @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        origin = origin + p[i] * rotation[:, 2]
        points.append(origin)
        origin = origin + p[n + i] * rotation[:, 0]
        points.append(origin)
        c, s = np.cos(p[2 * n + i]), np.sin(p[2 * n + i])
        rotation = rotation @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    return np.array(points)


def _draw_arms(axes: Any, problem: DesignProblem, result: DesignResult) -> None:
    p = problem.parameters(result.table)
    for goal, (subset, q, value) in enumerate(weakest_postures(problem, p)):
        frozen = ', '.join(
            f'{plain(result.table.joints[j].name)} at {np.rad2deg(q[j]):.0f}°'
            for j in problem.sets.frozen[subset]
        )
        miss = '' if value <= ZERO else f', misses by {np.sqrt(value):.2g} m'
        line = axes.plot(*_links(problem, p, q).T, marker='o', markersize=3, label=frozen + miss)
        x, y, z = problem.goals.positions[goal]
        axes.scatter([x], [y], [z], color=line[0].get_color(), marker='*', s=90)
    axes.set_title('the hardest ROD of each goal')
    axes.set_xlabel('x (m)')
    axes.set_ylabel('y (m)')
    axes.set_zlabel('z (m)')
    axes.set_aspect('equal')
    axes.legend(fontsize=7)


def _draw_slice(axes: Any, problem: DesignProblem, result: DesignResult, cells: int) -> None:
    """Judge a grid of positions in the half-plane through the base's axis and the first goal."""
    chain = result.table.chain()
    goals = problem.goals.positions[: problem.goal_count]
    reach = 1.4 * problem.reach
    radii = np.linspace(0.0, reach, cells)
    heights = np.linspace(goals[:, 2].mean() - reach, goals[:, 2].mean() + reach, cells)
    direction = np.array([goals[0, 0], goals[0, 1], 0.0])
    length = np.linalg.norm(direction)
    direction = direction / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    rho, z = (grid.ravel() for grid in np.meshgrid(radii, heights))
    points = rho[:, None] * direction + z[:, None] * np.array([0.0, 0.0, 1.0])
    settings = FtwsSettings(intervals=False, margin=False, boxes=20_000)
    results = query(chain, points, order=problem.spec.order, settings=settings, threads=2)
    for verdict, color in _COLORS.items():
        chosen = np.array([r.verdict is verdict for r in results])
        if chosen.any():
            axes.scatter(rho[chosen], z[chosen], c=color, s=14, marker='s', label=verdict.value)
    axes.scatter(
        np.hypot(goals[:, 0], goals[:, 1]),
        goals[:, 2],
        c='k',
        marker='*',
        s=90,
        label='goals, turned into it',
    )
    axes.set_title(f'order-{problem.spec.order} FTWS, slice through the base axis and goal 1')
    axes.set_xlabel('distance from the base axis (m)')
    axes.set_ylabel('z (m)')
    axes.set_aspect('equal')
    axes.legend(fontsize=7)


def _draw_penalties(axes: Any, penalties: Sequence[float]) -> None:
    floor = 1e-9
    values = np.maximum(np.array(penalties, dtype=float), floor)
    axes.semilogy(np.arange(1, len(values) + 1), values, color='0.7', lw=1, label='accepted')
    if len(values):
        axes.semilogy(
            np.arange(1, len(values) + 1), np.minimum.accumulate(values), color='k', label='best'
        )
    axes.set_title('penalty (equation 7); zero is drawn at 1e-9')
    axes.set_xlabel('accepted candidate')
    axes.set_ylabel('m² + rad²')
    axes.legend(fontsize=7)
