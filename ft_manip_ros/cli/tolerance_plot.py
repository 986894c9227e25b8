"""Picture of what a motion survives: instants by joints, green where a lock is survived."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib

matplotlib.use('Agg')
import matplotlib.pyplot as plt
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.patches import Patch

from ft_manip_ros.core.goal import Task
from ft_manip_ros.core.planning.tolerance import ToleranceMap
from ft_manip_ros.core.plot_text import plain
from ft_manip_ros.core.whole_file import write_figure

# By `Fate`: lost, open, survived.
_COLORS = ('#c0392b', '#bdbdbd', '#2e9e4f')
_LABELS = ('a goal is lost (proved)', 'open', 'the rest can be finished')


def draw(
    maps: Mapping[str, ToleranceMap],
    arrivals: Mapping[str, Mapping[int, float]],
    task: Task,
    path: str | Path,
) -> None:
    """Draw one panel a motion, with the arrivals at the goals, and save it."""
    figure, axes = plt.subplots(
        len(maps), 1, figsize=(9.0, 2.6 * len(maps) + 0.6), squeeze=False, layout='constrained'
    )
    for axis, (name, judged) in zip(axes[:, 0], maps.items(), strict=True):
        end = float(judged.times[-1])
        axis.imshow(
            judged.fates.T,
            aspect='auto',
            interpolation='nearest',
            cmap=ListedColormap(_COLORS),
            norm=BoundaryNorm([-0.5, 0.5, 1.5, 2.5], 3),
            extent=(0.0, end, len(judged.joint_names) - 0.5, -0.5),
        )
        axis.set_yticks(range(len(judged.joint_names)), map(plain, judged.joint_names))
        axis.set_xlabel('time of the lock (s)')
        share = f'{100.0 * judged.any_joint:.0f} %'
        axis.set_title(f'{plain(name)} path: any joint may lock for {share} of the time', pad=16)
        for index, arrival in arrivals[name].items():
            axis.axvline(arrival, color='black', linewidth=0.8)
            goal = plain(task.goals[index].id) or str(index)
            axis.text(arrival, -0.55, goal, ha='center', va='bottom', fontsize=7)
    figure.legend(
        handles=[Patch(color=c, label=t) for c, t in zip(_COLORS, _LABELS, strict=True)],
        loc='outside lower center',
        ncols=3,
        frameon=False,
    )
    write_figure(path, figure, 130)
