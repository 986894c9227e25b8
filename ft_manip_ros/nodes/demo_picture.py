"""One picture of a run: the arm before and after, and its joints over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use('Agg')

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from mpl_toolkits.mplot3d import proj3d

from ft_manip_ros.core.chain import Array, SerialChain, joint_motion
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.whole_file import write_figure
from ft_manip_ros.nodes.demo_record import Point, Record

_ARM, _GHOST, _LOCKED, _GOOD = '#27476e', '#a9bdd6', '#d1292c', '#22893f'
_PANELS = 3
# Where the names of points stand beside them, in turn (pt).
_LABELS = ((0.0, 30.0), (0.0, -30.0), (32.0, 18.0), (-32.0, -18.0), (32.0, -18.0))


def draw(record: Record, path: Path) -> None:
    """Write the picture of a run as PNG."""
    shown = _shown(record)
    figure = plt.figure(figsize=(16.0, 10.0), layout='constrained')
    figure.suptitle(_title(record), fontsize=17, fontweight='bold')
    arms, joints = figure.subfigures(2, 1, squeeze=False)[:, 0]
    plots = [
        arms.add_subplot(1, 1 + len(shown), 1 + k, projection='3d') for k in range(1 + len(shown))
    ]
    # Labels are placed by the projection, so the view comes first.
    _same_box(plots, record)
    _draw_before(plots[0], record)
    for axes, point in zip(plots[1:], shown, strict=True):
        _draw_after(axes, record, point)
    arms.legend(
        handles=_symbols(), loc='outside lower center', ncols=6, fontsize=11, frameon=False
    )
    _draw_joints(joints.add_subplot(), record)
    write_figure(path, figure, 100)


def link_points(chain: SerialChain, q: Array) -> Array:
    """Places of base, joints and tool at posture ``q``, shape (n + 2, 3), m."""
    rotation, position = np.eye(3), np.zeros(3)
    points = [position]
    axes, moved = chain.axes, chain.axis_positions(q)
    for i in range(len(axes) + 1):
        position = position + rotation @ chain.translations[i]
        rotation = rotation @ chain.rotations[i]
        points.append(position)
        if i < len(axes):
            turn, shift = joint_motion(axes[i].prismatic, float(moved[i]))
            position = position + rotation @ shift
            rotation = rotation @ turn
    return np.array(points)


def _title(record: Record) -> str:
    left = [p for p in record.points if p.fate != 'reached before']
    reached = [p for p in left if p.planned and p.reached]
    text = f'{record.joint} locked in the middle of the task: '
    if len(reached) == len(left):
        what = 'the remaining point' if len(left) == 1 else f'all {len(left)} remaining points'
        return text + f'the arm still reached {what} (within {record.worst_error * 1e3:.2f} mm)'
    return text + f'{len(reached)} of {len(left)} remaining points reached, the others are told'


def _symbols() -> list[Line2D]:
    def symbol(label: str, **style: Any) -> Line2D:
        return Line2D([], [], label=label, **style)

    return [
        symbol('base', ls='', marker='s', color='#444444', ms=10),
        symbol('joint', ls='', marker='o', color='white', mec=_ARM, ms=8, mew=2),
        symbol('locked joint', ls='', marker='X', color=_LOCKED, ms=12),
        symbol('task point', ls='', marker='*', color='white', mec='black', ms=15),
        symbol('reached', ls='', marker='*', color=_GOOD, ms=15),
        symbol('way of the tool; first picture: the arm at the start', color=_GHOST, lw=2.5),
    ]


def _shown(record: Record) -> list[Point]:
    """Points after the failure that get a panel: all, or the first, the middle and the last."""
    after = [p for p in record.points if p.planned]
    if len(after) > _PANELS:
        after = [after[round(k * (len(after) - 1) / (_PANELS - 1))] for k in range(_PANELS)]
    return after


def _draw_before(axes: Any, record: Record) -> None:
    rows = np.flatnonzero((record.stamps >= record.started) & (record.stamps <= record.locked_at))
    axes.plot(*fk(record.chain, record.positions[rows])[1].T, color=_GHOST, lw=2)
    _draw_arm(axes, record, record.positions[rows[0]], ghost=True)
    _draw_arm(axes, record, record.positions[rows[-1]])
    for k, point in enumerate(record.points):
        _draw_point(axes, k, point, done=point.fate == 'reached before')
    axes.set_title(f'{record.joint} locks here, on the way', fontsize=13, color=_LOCKED)


def _draw_after(axes: Any, record: Record, shown: Point) -> None:
    rows = np.flatnonzero((record.stamps > record.locked_at) & (record.stamps <= shown.at))
    axes.plot(*fk(record.chain, record.positions[rows])[1].T, color=_GHOST, lw=2)
    _draw_arm(axes, record, record.positions[rows[-1]])
    for k, point in enumerate(record.points):
        _draw_point(axes, k, point, done=point.reached and point.at <= shown.at)
    text = f'{shown.name}: missed by {shown.error * 1e3:.1f} mm'
    if shown.reached:
        text = f'{shown.name} reached without it, {shown.error * 1e3:.3f} mm off'
    axes.set_title(text, fontsize=13, color=_GOOD if shown.reached else _LOCKED)


def _draw_arm(axes: Any, record: Record, q: Array, *, ghost: bool = False) -> None:
    points = link_points(record.chain, q)
    color = _GHOST if ghost else _ARM
    axes.plot(*points.T, color=color, lw=2.5 if ghost else 5, solid_capstyle='round', zorder=5)
    axes.plot(*points[:1].T, 's', color='#444444', ms=13, zorder=6)
    if ghost:
        return
    axes.plot(*points[1:-1].T, 'o', color='white', mec=color, ms=8, mew=2, zorder=10)
    place = points[1 + record.chain.index(record.joint)]
    axes.plot(*place[:, None], 'o', color=_LOCKED, mec='white', ms=15, zorder=20)
    axes.plot(*place[:, None], 'x', color='white', ms=7, mew=2.5, zorder=21)


def _draw_point(axes: Any, k: int, point: Point, *, done: bool) -> None:
    color = _GOOD if done else (_LOCKED if point.fate == 'lost' else 'black')
    axes.plot(
        *point.position[:, None],
        '*',
        ms=18,
        color=color if done else 'white',
        mec=color,
        zorder=30,
    )
    x, y, _ = proj3d.proj_transform(*point.position, axes.get_proj())
    label = axes.annotate(
        point.name,
        (x, y),
        xytext=_LABELS[k % len(_LABELS)],
        textcoords='offset points',
        color=color,
        fontsize=12,
        fontweight='bold',
        ha='center',
        va='center',
        zorder=40,
        arrowprops={'arrowstyle': '-', 'color': color, 'lw': 0.8},
    )
    label.set_path_effects([withStroke(linewidth=3, foreground='white')])


def _same_box(plots: list[Any], record: Record) -> None:
    """Give all plots one cube around the arm, so that they can be compared."""
    every = max(1, len(record.positions) // 200)
    places = np.concatenate([link_points(record.chain, q) for q in record.positions[::every]])
    places = np.concatenate([places, [goal.position for goal in record.task.goals]])
    middle = 0.5 * (places.max(axis=0) + places.min(axis=0))
    half = 0.5 * float(np.ptp(places, axis=0).max())
    for axes in plots:
        axes.set_xlim(middle[0] - half, middle[0] + half)
        axes.set_ylim(middle[1] - half, middle[1] + half)
        axes.set_zlim(middle[2] - half, middle[2] + half)
        axes.set_box_aspect((1, 1, 1), zoom=1.15)
        axes.set_xlabel('x (m)', labelpad=-6, fontsize=9)
        axes.set_ylabel('y (m)', labelpad=-6, fontsize=9)
        axes.set_zlabel('z (m)', labelpad=-9, fontsize=9)
        axes.tick_params(labelsize=7, pad=-2)
        axes.locator_params(nbins=5)
        axes.view_init(elev=22.0, azim=-60.0)


def _draw_joints(axes: Any, record: Record) -> None:
    chain = record.chain
    rows = record.stamps >= record.started - 3e8
    time = (record.stamps[rows] - record.started) * 1e-9
    scale = np.array([1.0 if joint.prismatic else 180.0 / np.pi for joint in chain.joints])
    q = record.positions[rows] * scale
    locked = (record.locked_at - record.started) * 1e-9
    index = chain.index(record.joint)
    colors = plt.get_cmap('viridis')(np.linspace(0.05, 0.85, chain.n))
    for i, name in enumerate(chain.joint_names):
        if i != index:
            axes.plot(time, q[:, i], color=colors[i], lw=1.6, label=name)
    axes.plot(time, q[:, index], color=_LOCKED, lw=3.5, label=f'{record.joint} (locks)')
    start, path = record.commands[0]
    end = (record.plan_heard - start) * 1e-9
    asked = np.arange(max(locked, 0.0), min(path.duration, max(end, locked) + 1.0), 0.02)
    if len(asked):
        column = path.joint_names.index(record.joint)
        line = np.array([path.sample(t)[0][column] for t in asked]) * scale[index]
        axes.plot(asked, line, ':', color=_LOCKED, lw=1.8, label='what it was told to do')
    axes.axvline(locked, color=_LOCKED, lw=2)
    axes.axvspan(locked, (record.plan_heard - record.started) * 1e-9, color=_LOCKED, alpha=0.15)
    lower, upper = axes.get_ylim()
    axes.set_ylim(lower, upper + 0.28 * (upper - lower))
    axes.annotate(
        f'{record.joint} locks\nseen after {record.detection_latency * 1e3:.0f} ms\n'
        f'new plan after {record.plan_latency * 1e3:.0f} ms',
        (locked, axes.get_ylim()[1]),
        xytext=(6, -6),
        textcoords='offset points',
        va='top',
        color=_LOCKED,
        fontsize=11,
        fontweight='bold',
    )
    for point in record.points:
        if point.reached:
            at = (point.at - record.started) * 1e-9
            axes.axvline(at, color=_GOOD, lw=1.2, ls='--')
            axes.annotate(
                f'{point.name} reached',
                (at, axes.get_ylim()[0]),
                xytext=(4, 6),
                textcoords='offset points',
                color=_GOOD,
                fontsize=11,
                rotation=90,
                va='bottom',
            )
    axes.set_xlim(time[0], time[-1])
    axes.set_xlabel('time since the start of the motion (s)')
    axes.set_ylabel('joint position (deg)' if (scale > 1.0).all() else 'joint position (deg, m)')
    axes.grid(alpha=0.3)
    handles, _ = axes.get_legend_handles_labels()
    handles.append(Line2D([], [], color=_GOOD, ls='--', label='point reached'))
    axes.legend(handles=handles, loc='upper left', bbox_to_anchor=(1.0, 1.0), fontsize=11)
