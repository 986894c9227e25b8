"""Regenerate the paper's figures 3 to 7 from the engine: ``python -m bench.figures [N ...]``.

Blue cells are proved members and white ones proved non-members, as wholes. Where a cell is not
proved as a whole, the verdict on its centre is drawn paler (pale blue member, grey non-member),
and orange is what stays undecided.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from bench.ftws_arms import limited
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.ftws.critical import critical_values
from ft_manip_ros.core.ftws.ftws_map import FtwsMap
from ft_manip_ros.core.ftws.map_build import build_map
from ft_manip_ros.core.ftws.map_frame import map_frame
from ft_manip_ros.core.ftws.map_plot import draw_map
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import Verdict
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.ik import solve_ik
from ft_manip_ros.core.kinematics import isotropy, jacobian

matplotlib.use('Agg')

FOLDER = Path(__file__).parent.parent / 'docs' / 'figures'
THREADS = os.cpu_count() or 1


def slice_map(
    chain: SerialChain, kind: str, low: list[float], high: list[float], depth: int
) -> FtwsMap:
    """Map, with a line about it."""
    made = build_map(
        chain, map_frame(chain, kind), low=low, high=high, depth=depth, threads=THREADS
    )
    lower, upper = made.measure()
    print(f'  {chain.name}: {lower:.4f} to {upper:.4f}', flush=True)
    return made


def draw(axes: Any, chain: SerialChain, made: FtwsMap) -> None:
    """Draw a map, with the centres of its open cells judged one by one."""
    points, verdicts = made.cells()
    codes = {Verdict.MEMBER: 1, Verdict.UNDECIDED: 0, Verdict.NON_MEMBER: -1}
    open_cells = np.flatnonzero(verdicts == 0)
    centres = np.zeros(len(points), dtype=np.int8)
    settings = FtwsSettings(intervals=False, boxes=20_000)
    answers = query(chain, points[open_cells], settings=settings, threads=THREADS)
    centres[open_cells] = [codes[answer.verdict] for answer in answers]
    draw_map(axes, made, centres.reshape(made.grid.shape))


def save(figure: Figure, number: int) -> None:
    """Write ``figure_N.png``."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    figure.savefig(FOLDER / f'figure_{number}.png', dpi=110)
    print(f'docs/figures/figure_{number}.png', flush=True)


def figure_3() -> None:
    """Table 1: cross-section of the FTWS among its critical value manifolds."""
    chain = load_arm('paredis_table_1')
    figure = Figure(figsize=(5.5, 6.5), layout='constrained')
    axes = figure.subplots()
    draw(axes, chain, slice_map(chain, 'rz', [0.0, -4.2], [4.2, 4.2], 7))
    points, _ = critical_values(chain, 6001)
    axes.plot(points[:, 0], points[:, 1], 'k.', markersize=0.4)
    axes.set_xlim(0.0, 5.1)
    axes.set_title('Figure 3: FTWS of Table 1 (blue) and critical values (black)', fontsize=10)
    save(figure, 3)


def figure_4() -> None:
    """Planar 4R with joint limits."""
    figure = Figure(figsize=(10.0, 7.0), layout='constrained')
    for axes, degrees in zip(
        figure.subplots(2, 3).ravel(), (180, 150, 120, 90, 60, 30), strict=True
    ):
        chain = limited('planar_4r', degrees)
        draw(axes, chain, slice_map(chain, 'xy', [-2.2, -3.2], [4.2, 3.2], 6))
        axes.set_title(f'limits ±{degrees}°', fontsize=9)
    figure.suptitle('Figure 4: FTWS of the planar 4R arm with joint limits', fontsize=10)
    save(figure, 4)


def figure_5() -> None:
    """Table 1 with joint limits: shrinks, opens a hole, splits, vanishes."""
    figure = Figure(figsize=(10.0, 7.0), layout='constrained')
    for axes, degrees in zip(
        figure.subplots(2, 3).ravel(), (180, 175, 170, 165, 160, 155), strict=True
    ):
        chain = limited('paredis_table_1', degrees)
        draw(axes, chain, slice_map(chain, 'xz', [-2.2, -2.2], [2.2, 2.2], 6))
        axes.set_title(f'limits ±{degrees}°', fontsize=9)
    figure.suptitle('Figure 5: FTWS of Table 1 with joint limits, x-z plane', fontsize=10)
    save(figure, 5)


def figure_6() -> None:
    """Penalty of the innermost minimisation and isotropy over one frozen angle."""
    chain = load_arm('paredis_table_3')
    goal = Goal(np.array([1.35, 0.0, 0.6]))
    name = chain.joint_names[0]
    angles = np.linspace(chain.operating_lower[0], chain.operating_upper[0], 241)
    penalties, measures = [], []
    for angle in angles:
        rod = chain.freeze({name: float(angle)})
        best = solve_ik(rod, goal)
        penalties.append(best.position_error**2 if best.position_error > 1e-5 else 0.0)
        measures.append(isotropy(jacobian(rod, best.q)[:3]))
    figure = Figure(figsize=(7.0, 5.0), layout='constrained')
    upper, lower = figure.subplots(2, 1, sharex=True)
    upper.plot(np.degrees(angles), penalties)
    upper.set_ylabel('penalty (m²)')
    lower.plot(np.degrees(angles), measures, color='tab:orange')
    lower.set_ylabel('isotropy Δ')
    lower.set_xlabel(f'{name} frozen at (deg)')
    figure.suptitle('Figure 6: penalty and isotropy, Table 3, goal (1.35, 0, 0.6)', fontsize=10)
    save(figure, 6)


def figure_7() -> None:
    """Table 3 at ±150 degrees: cross-section with the task points that lie in it."""
    chain = load_arm('paredis_table_3')
    figure = Figure(figsize=(6.0, 6.0), layout='constrained')
    axes = figure.subplots()
    draw(axes, chain, slice_map(chain, 'xz', [-1.35, -1.35], [1.35, 1.35], 7))
    axes.plot([0.5, 0.75], [0.5, 0.5], 'kx')
    axes.set_title('Figure 7: FTWS of Table 3 at ±150°, x-z plane, with p1 and p3', fontsize=10)
    save(figure, 7)


FIGURES = {3: figure_3, 4: figure_4, 5: figure_5, 6: figure_6, 7: figure_7}


def main() -> None:
    """Draw the figures that are named, or all."""
    parser = argparse.ArgumentParser(description="Regenerate the paper's figures.")
    parser.add_argument('figures', nargs='*', type=int, metavar='N', help='3 to 7')
    numbers = parser.parse_args().figures or list(FIGURES)
    if not set(numbers) <= set(FIGURES):
        parser.error('there are figures 3 to 7')
    for number in numbers:
        FIGURES[number]()


if __name__ == '__main__':
    main()
