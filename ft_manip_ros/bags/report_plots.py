"""The pictures of a report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib

matplotlib.use('Agg')

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ft_manip_ros.bags.report_data import OUTCOMES, ReportData
from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.plot_text import plain
from ft_manip_ros.core.whole_file import write_figure

_COLORS = {'reachable': '#2a9d4a', 'relaxed': '#d9a400', 'lost': '#c62828', 'undecided': '#777777'}
_MEASURED, _COMMANDED, _FAULT = '#1f4e9c', '#999999', '#c62828'
_WIDTH = 9.0  # inches
_MOST_JOINTS = 24


def draw(data: ReportData, folder: Path) -> dict[str, Path]:
    """Draw what the data allows into PNG files; return them by title."""
    pictures: dict[str, tuple[str, Callable[[ReportData], Figure]]] = {}
    if data.joints:
        pictures['Joints'] = ('joints.png', _joints)
    if data.tool is not None:
        pictures['Tool path'] = ('tool_path.png', _tool_path)
        if data.goals:
            pictures['Distance of the tool from each goal'] = ('distances.png', _distances)
    found = {}
    for title, (name, make) in pictures.items():
        write_figure(folder / name, make(data), 110)
        found[title] = folder / name
    return found


def _joints(data: ReportData) -> Figure:
    names = list(data.joints)[:_MOST_JOINTS]
    figure, axes = plt.subplots(
        len(names), 1, sharex=True, squeeze=False, figsize=(_WIDTH, 1.3 * len(names) + 0.8)
    )
    for name, axis in zip(names, axes[:, 0], strict=True):
        _commanded(axis, data.commands.get(name, ()))
        times, values = data.joints[name]
        axis.plot(times, values, color=_MEASURED, linewidth=1, label='measured')
        for when, joint, frozen in data.locks:
            axis.axvline(when, color=_FAULT, linewidth=1, alpha=1.0 if joint == name else 0.3)
            if joint == name:
                axis.axhline(frozen, color=_FAULT, linestyle=':', linewidth=1)
                axis.annotate(
                    f'LOCKED at {frozen:.4f}', (when, frozen), color=_FAULT, fontsize=8,
                    xytext=(4, 4), textcoords='offset points',
                    bbox={'facecolor': 'white', 'edgecolor': 'none', 'alpha': 0.8, 'pad': 1},
                )  # fmt: skip
        axis.set_ylabel(f'{plain(name)}\n(rad or m)', fontsize=8)
        axis.tick_params(labelsize=7)
        axis.grid(alpha=0.3)
    axes[-1, 0].set_xlabel('time (s)')
    handles, labels = axes[0, 0].get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(unique.values(), unique.keys(), loc='upper right', fontsize=8, ncols=3)
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 1.0 - 0.3 / figure.get_figheight()))
    return figure


def _commanded(axis: Axes, commands: Sequence[tuple[Array, Array]]) -> None:
    """Draw the trajectories of a joint, each as in force until the next one begins."""
    commands = [(times, values) for times, values in commands if len(times)]
    for k, (times, values) in enumerate(commands):
        end = commands[k + 1][0][0] if k + 1 < len(commands) else np.inf
        cut = np.interp(end, times, values)
        kept, later = times < end, times > end
        axis.plot(
            np.append(times[kept], min(end, times[-1])), np.append(values[kept], cut),
            color=_COMMANDED, linewidth=3, alpha=0.6, label='commanded',
        )  # fmt: skip
        if later.any():
            axis.plot(
                np.append(end, times[later]), np.append(cut, values[later]),
                color=_COMMANDED, linewidth=1, linestyle='--', label='commanded, then replaced',
            )  # fmt: skip


def _goal_colors(data: ReportData) -> list[str]:
    fates = dict.fromkeys(range(len(data.goals)), 'reachable')
    for _, plan in data.plans:
        for report in plan.goals:
            if report.index in fates and report.outcome < len(OUTCOMES):
                fates[report.index] = OUTCOMES[report.outcome]
    return [_COLORS[fate] for fate in fates.values()]


def _tool_path(data: ReportData) -> Figure:
    assert data.tool is not None
    times, path = data.tool
    split = min((when for when, _, _ in data.locks), default=np.inf)
    figure, axes = plt.subplots(1, 2, figsize=(_WIDTH, 4.4))
    for axis, (a, b) in zip(axes, ((0, 1), (0, 2)), strict=True):
        before, after = times <= split, times >= split
        axis.plot(*path[before][:, [a, b]].T, color=_MEASURED, linewidth=1, label='before')
        if after.any():
            axis.plot(
                *path[after][:, [a, b]].T, color=_FAULT, linewidth=1, label='after the fault'
            )
        for (name, goal), color in zip(data.goals, _goal_colors(data), strict=True):
            axis.scatter(goal[a], goal[b], color=color, s=40, zorder=3)
            axis.annotate(
                plain(name),
                (goal[a], goal[b]),
                fontsize=8,
                xytext=(5, 5),
                textcoords='offset points',
            )
        axis.set_xlabel(f'{"xyz"[a]} (m)')
        axis.set_ylabel(f'{"xyz"[b]} (m)')
        axis.set_aspect('equal', adjustable='datalim')
        axis.grid(alpha=0.3)
    axes[0].legend(fontsize=8)
    figure.tight_layout()
    return figure


def _distances(data: ReportData) -> Figure:
    assert data.tool is not None
    times, path = data.tool
    figure, axis = plt.subplots(figsize=(_WIDTH, 3.2))
    for k, (name, goal) in enumerate(data.goals):
        distance = np.linalg.norm(path - goal, axis=1)
        axis.semilogy(times, np.maximum(distance, 1e-6) * 1e3, label=plain(name) or f'goal {k}')
    for when, joint, _ in data.locks:
        axis.axvline(when, color=_FAULT, linewidth=1)
        axis.annotate(
            f'{plain(joint)} locked', (when, 0.02), xycoords=('data', 'axes fraction'), fontsize=8,
            color=_FAULT, rotation=90, ha='right', va='bottom',
        )  # fmt: skip
    axis.axhline(1.0, color='black', linewidth=0.5, linestyle=':')
    axis.set_xlabel('time (s)')
    axis.set_ylabel('distance (mm)')
    axis.grid(alpha=0.3)
    axis.legend(fontsize=8)
    figure.tight_layout()
    return figure
