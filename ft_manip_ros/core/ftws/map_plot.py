"""Pictures of FTWS maps."""

from __future__ import annotations

import os
from typing import Any

import matplotlib
import numpy as np
from matplotlib.colors import ListedColormap
from numpy.typing import NDArray

from ft_manip_ros.core.ftws.ftws_map import FtwsMap
from ft_manip_ros.core.plot_text import plain
from ft_manip_ros.core.whole_file import write_figure

matplotlib.use('Agg')

_COLOURS = ListedColormap(['#f4f4f4', '#e8a33d', '#3b7dd8'])
# Cells of which only the centre was judged.
_CENTRE_COLOURS = ListedColormap(['#dcdcdc', '#e8a33d', '#a9c8ee'])


def draw_map(axes: Any, ftws_map: FtwsMap, centres: NDArray[np.int8] | None = None) -> None:
    """Draw a two-dimensional map into matplotlib axes: member, not proved, non-member.

    Parameters
    ----------
    centres : shape of the map's grid
        Verdicts on the centres of the cells that are not proved as wholes, drawn paler.
    """
    low, high = ftws_map.low, ftws_map.high
    if centres is not None:
        axes.imshow(
            centres.T,
            origin='lower',
            extent=(low[0], high[0], low[1], high[1]),
            cmap=_CENTRE_COLOURS,
            vmin=-1,
            vmax=1,
            interpolation='nearest',
        )
    shown = ftws_map.grid if centres is None else np.ma.masked_equal(ftws_map.grid, 0)
    axes.imshow(
        shown.T,
        origin='lower',
        extent=(low[0], high[0], low[1], high[1]),
        cmap=_COLOURS,
        vmin=-1,
        vmax=1,
        interpolation='nearest',
        aspect='equal',
    )
    names = {'rz': ('rho (m)', 'z (m)')}.get(
        ftws_map.frame.kind, tuple(f'{name} (m)' for name in ftws_map.frame.kind[:2])
    )
    axes.set_xlabel(names[0])
    axes.set_ylabel(names[1])


def plot_map(ftws_map: FtwsMap, path: str | os.PathLike[str]) -> None:
    """Write a picture; a volume is shown by six slices along its last coordinate.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    from matplotlib.figure import Figure

    lower, upper = ftws_map.measure()
    unit = ftws_map.frame.unit.replace('^2', '²').replace('^3', '³')
    title = (
        f'{plain(ftws_map.arm)}: order {ftws_map.order} FTWS, {lower:.4g} to {upper:.4g} {unit}'
    )
    if ftws_map.frame.dimension == 2:
        figure = Figure(figsize=(6.0, 6.0), layout='constrained')
        draw_map(figure.subplots(), ftws_map)
    else:
        figure = Figure(figsize=(10.0, 7.0), layout='constrained')
        count = ftws_map.grid.shape[2]
        width = (ftws_map.high[2] - ftws_map.low[2]) / count
        places = np.linspace(0, count - 1, 8)[1:-1].astype(int)
        for axes, k in zip(figure.subplots(2, 3).ravel(), places, strict=True):
            axes.imshow(
                ftws_map.grid[:, :, k].T,
                origin='lower',
                extent=(ftws_map.low[0], ftws_map.high[0], ftws_map.low[1], ftws_map.high[1]),
                cmap=_COLOURS,
                vmin=-1,
                vmax=1,
            )
            axes.set_title(f'z = {ftws_map.low[2] + (k + 0.5) * width:.3g} m', fontsize=9)
    figure.suptitle(f'{title}\nblue: member, orange: not proved', fontsize=10)
    write_figure(path, figure, 120)
