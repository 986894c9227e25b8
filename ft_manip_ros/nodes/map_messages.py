"""FTWS maps as a point cloud and as markers."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import Point
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.ftws.ftws_map import FtwsMap
from ft_manip_ros.nodes.conversions import stamp

_POINT = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('verdict', '<f4')])
_SURFACE = ColorRGBA(r=0.23, g=0.49, b=0.85, a=0.6)


def map_cloud(ftws_map: FtwsMap, frame: str, ns: int) -> PointCloud2:
    """Centres of the cells that are not lost; ``verdict`` is 1 (member) or 0 (not proved)."""
    points, verdicts = ftws_map.cells()
    shown = verdicts >= 0
    rows = np.zeros(int(shown.sum()), dtype=_POINT)
    for axis, name in enumerate('xyz'):
        rows[name] = points[shown, axis]
    rows['verdict'] = verdicts[shown]
    cloud = PointCloud2(
        height=1,
        width=len(rows),
        fields=[
            PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
            for i, name in enumerate(_POINT.names or ())
        ],
        is_bigendian=False,
        point_step=_POINT.itemsize,
        row_step=rows.nbytes,
        data=rows.tobytes(),
        is_dense=True,
    )
    cloud.header.frame_id = frame
    cloud.header.stamp = stamp(ns)
    return cloud


def map_markers(ftws_map: FtwsMap, frame: str, ns: int, limit: int) -> MarkerArray:
    """Cubes where the proved members of a volume end, or all proved members of a slice.

    Parameters
    ----------
    limit
        Largest number of cubes; of more, every second, third, ... is drawn.
    """
    shown = ftws_map.grid == 1
    if ftws_map.frame.dimension == 3:
        shown &= ~_surrounded(shown)
    points = ftws_map.cells()[0][shown.ravel()]
    points = points[:: max(1, -(-len(points) // limit))]
    marker = Marker(ns='ftws_map', type=Marker.CUBE_LIST, action=Marker.ADD, color=_SURFACE)
    marker.header.frame_id = frame
    marker.header.stamp = stamp(ns)
    marker.scale.x, marker.scale.y, marker.scale.z = _sides(ftws_map)
    marker.pose.orientation.w = 1.0
    marker.points = [Point(x=x, y=y, z=z) for x, y, z in points.tolist()]
    return MarkerArray(markers=[marker])


def _surrounded(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Cells whose neighbours across every face are set, too."""
    inner = np.zeros_like(cells)
    inner[(slice(1, -1),) * cells.ndim] = True
    for axis in range(cells.ndim):
        for step in (-1, 1):
            inner &= np.roll(cells, step, axis)
    return inner


def _sides(ftws_map: FtwsMap) -> tuple[float, float, float]:
    """Sides of a cell along x, y and z (m); a slice is a tenth of a cell thick."""
    widths: Array = (ftws_map.high - ftws_map.low) / ftws_map.grid.shape[0]
    along = np.abs(ftws_map.frame.directions.T) @ widths
    x, y, z = np.maximum(along, 0.1 * float(widths.min())).tolist()
    return x, y, z
