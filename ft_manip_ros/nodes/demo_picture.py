"""One picture of a run: the arm before and after, and its joints over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use('Agg')

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.lines import Line2D

from ft_manip_ros.core.chain import Array, SerialChain, joint_motion
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.nodes.demo_record import Point, Record

_ARM, _GHOST, _LOCKED, _GOOD, _LOST = '#27476e', '#9bb1cc', '#d1292c', '#2a9d4a', '#b3261e'


def draw(record: Record, path: Path) -> None:
    """Write the picture of a run as PNG."""
    figure = plt.figure(figsize=(13.5, 9.5), layout='constrained')
    grid = figure.add_gridspec(2, 2, height_ratios=(1.15, 1.0))
    figure.suptitle(_title(record), fontsize=15, fontweight='bold')
    before = figure.add_subplot(grid[0, 0], projection='3d')
    after = figure.add_subplot(grid[0, 1], projection='3d')
    _draw_before(before, record)
    _draw_after(after, record)
    _same_box([before, after], record)
    _draw_joints(figure.add_subplot(grid[1, :]), record)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def link_points(chain: SerialChain, q: Array) -> Array:
    """Places of base, joints and tool at posture ``q``, shape (n + 2, 3), m."""
    rotation, position = np.eye(3), np.zeros(3)
    points = [position]
    for i in range(chain.n + 1):
        position = position + rotation @ chain.translations[i]
        rotation = rotation @ chain.rotations[i]
        points.append(position)
        if i < chain.n:
            turn, shift = joint_motion(chain.joints[i].prismatic, float(q[i]))
            position = position + rotation @ shift
            rotation = rotation @ turn
    return np.array(points)


def _title(record: Record) -> str:
    left = [p for p in record.points if p.fate != 'reached before']
    reached = [p for p in left if p.planned and p.reached]
    text = f'{record.joint} locked in the middle of the task: '
    if len(reached) == len(left):
        return text + (
            f'the arm reached all {len(left)} remaining points all the same '
            f'(within {record.worst_error * 1e3:.2f} mm)'
        )
    return text + f'{len(reached)} of {len(left)} remaining points reached, the others are told'


def _draw_before(axes: Any, record: Record) -> None:
    moving = (record.stamps >= record.started) & (record.stamps <= record.locked_at)
    rows = np.flatnonzero(moving)
    tool = fk(record.chain, record.positions[rows])[1]
    axes.plot(*tool.T, color=_GHOST, lw=2)
    _draw_arm(axes, record, record.positions[rows[0]], _GHOST, lw=2.5)
    _draw_arm(axes, record, record.positions[rows[-1]], _ARM, lw=5, locked=True)
    for point in record.points:
        _draw_point(axes, point, done=point.fate == 'reached before')
    axes.set_title(f'Until {record.joint} locks', fontsize=12)


def _draw_after(axes: Any, record: Record) -> None:
    rows = np.flatnonzero(record.stamps > record.locked_at)
    tool = fk(record.chain, record.positions[rows])[1]
    axes.plot(*tool.T, color=_GHOST, lw=2)
    for point in record.points:
        if point.planned:
            nearest = rows[int(np.argmin(np.abs(record.stamps[rows] - point.at)))]
            _draw_arm(axes, record, record.positions[nearest], _ARM, lw=4, locked=True)
        _draw_point(axes, point, done=point.reached and point.fate != 'lost')
    axes.set_title(
        f'After: the arm at each remaining point, {record.joint} held where it stopped',
        fontsize=12,
    )


def _draw_arm(
    axes: Any, record: Record, q: Array, color: str, *, lw: float, locked: bool = False
) -> None:
    points = link_points(record.chain, q)
    axes.plot(*points.T, color=color, lw=lw, solid_capstyle='round', alpha=0.9)
    axes.plot(*points[1:-1].T, 'o', color='white', mec=color, ms=lw + 2, mew=1.5)
    if locked:
        place = points[1 + record.chain.index(record.joint)]
        axes.plot(*place[:, None], 'o', color=_LOCKED, mec='white', ms=12, zorder=20)


def _draw_point(axes: Any, point: Point, *, done: bool) -> None:
    color = _GOOD if done else (_LOST if point.fate == 'lost' else 'black')
    axes.plot(
        *point.position[:, None],
        '*',
        ms=17,
        color=color if done else 'white',
        mec=color,
        zorder=30,
    )
    above = point.position + np.array([0.0, 0.0, 0.06])
    axes.text(*above, point.name, color=color, fontsize=11)


def _same_box(plots: list[Any], record: Record) -> None:
    """Give all plots one cube around the arm, so that they can be compared."""
    every = max(1, len(record.positions) // 200)
    places = np.concatenate([link_points(record.chain, q) for q in record.positions[::every]])
    places = np.concatenate([places, [goal.position for goal in record.task.goals]])
    middle = 0.5 * (places.max(axis=0) + places.min(axis=0))
    half = 0.52 * float(np.ptp(places, axis=0).max())
    for axes in plots:
        axes.set_xlim(middle[0] - half, middle[0] + half)
        axes.set_ylim(middle[1] - half, middle[1] + half)
        axes.set_zlim(middle[2] - half, middle[2] + half)
        axes.set_box_aspect((1, 1, 1))
        axes.set(xlabel='x (m)', ylabel='y (m)', zlabel='z (m)')
        axes.tick_params(labelsize=8)


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
            axes.text(
                at,
                axes.get_ylim()[0],
                f' {point.name} reached',
                color=_GOOD,
                rotation=90,
                va='bottom',
            )
    axes.set_xlim(time[0], time[-1])
    axes.set_xlabel('time since the start of the motion (s)')
    axes.set_ylabel('joint position (deg)' if (scale > 1.0).all() else 'joint position (deg, m)')
    axes.grid(alpha=0.3)
    handles, _ = axes.get_legend_handles_labels()
    handles.append(Line2D([], [], color=_GOOD, ls='--', label='point reached'))
    axes.legend(handles=handles, loc='upper right', ncols=2, fontsize=9, framealpha=0.95)
