"""The picture of `ftmanip detect`: signal, command, residual, threshold and decisions."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import matplotlib

matplotlib.use('Agg')
import matplotlib.pyplot as plt
import numpy as np

from ft_manip_ros.core.detection.offline import Trace
from ft_manip_ros.core.detection.states import Edge, JointState
from ft_manip_ros.core.plot_text import plain
from ft_manip_ros.core.whole_file import write_figure

COLORS = {
    JointState.SUSPECT: 'gold',
    JointState.LOCKED: 'red',
    JointState.STALE: 'grey',
    JointState.SENSOR: 'purple',
    JointState.RUNAWAY: 'black',
    JointState.PROVING: 'green',
    JointState.SLUGGISH: 'orange',
}


def draw(path: Path, title: str, trace: Trace, edges: Sequence[Edge]) -> None:
    """Draw one row a joint: motion on the left, evidence on the right.

    Raises
    ------
    InputError
        If the picture cannot be written.
    """
    n = len(trace.joints)
    times = np.array(trace.stamps) * 1e-9
    times = times - times[0] if len(times) else times
    figure, axes = plt.subplots(
        n, 2, figsize=(14, 1.9 * n + 1.0), sharex=True, squeeze=False, layout='constrained'
    )
    tables = {
        key: np.array(getattr(trace, key)).reshape(len(times), n)
        for key in ('positions', 'commands', 'residuals', 'thresholds', 'states')
    }
    for j, name in enumerate(trace.joints):
        motion, evidence = axes[j]
        motion.plot(times, tables['commands'][:, j], color='tab:blue', lw=0.8, label='command')
        motion.plot(times, tables['positions'][:, j], color='tab:red', lw=0.8, label='position')
        motion.set_ylabel(plain(name))
        evidence.plot(times, tables['residuals'][:, j], lw=0.8, label='residual')
        evidence.plot(times, tables['thresholds'][:, j], 'k--', lw=0.8, label='threshold')
        for axis in (motion, evidence):
            _shade(axis, times, tables['states'][:, j])
        for edge in edges:
            if edge.report.name == name and edge.report.state == JointState.LOCKED:
                at = (edge.stamp - trace.stamps[0]) * 1e-9
                motion.axvline(at, color='red', lw=1.2)
                motion.annotate(
                    f'LOCKED {edge.report.frozen_position:.4f}',
                    (at, edge.report.frozen_position),
                    fontsize=7,
                )
    axes[0, 0].legend(fontsize=7, loc='upper right')
    axes[0, 1].legend(fontsize=7, loc='upper right')
    for axis in axes[-1]:
        axis.set_xlabel('time (s)')
    shown = ', '.join(f'{color}: {state.name}' for state, color in COLORS.items())
    figure.suptitle(f'{plain(title)}   ({shown})', fontsize=9)
    write_figure(path, figure, 110)


def _shade(axis: plt.Axes, times: np.ndarray, states: np.ndarray) -> None:
    changes = np.flatnonzero(np.diff(states)) + 1
    bounds = [0, *changes.tolist(), len(states) - 1]
    for start, end in pairwise(bounds):
        color = COLORS.get(JointState(int(states[start]))) if len(states) else None
        if color is not None and end > start:
            axis.axvspan(times[start], times[end], color=color, alpha=0.25, lw=0)
