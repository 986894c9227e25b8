"""Maps as messages: every shown cell at its place, with its verdict."""

import numpy as np
import pytest

from ft_manip_ros.core.ftws.ftws_map import FtwsMap
from ft_manip_ros.core.ftws.map_frame import MapFrame
from ft_manip_ros.nodes.map_messages import map_cloud, map_markers

NS = 12_000_000_034


def volume(size: int = 8) -> FtwsMap:
    """A ball of members of radius 2 in a shell that is not proved, in a box of 2 x 4 x 8 m."""
    axis = np.arange(size) - 0.5 * (size - 1)
    radius = np.sqrt(sum(v**2 for v in np.meshgrid(axis, axis, axis, indexing='ij')))
    grid = np.where(radius < 2.0, 1, np.where(radius < 3.0, 0, -1)).astype(np.int8)
    frame = MapFrame('xyz', np.zeros(3), np.eye(3))
    low = np.array([-1.0, -2.0, -4.0])
    return FtwsMap('ball', 'digest', 1, 1e-6, frame, low, -low, grid)


def table(cloud):
    """Rows of a cloud as its fields describe them."""
    kinds = [(field.name, '<f4') for field in cloud.fields]
    assert [field.offset for field in cloud.fields] == [0, 4, 8, 12]
    return np.frombuffer(bytes(cloud.data), dtype=kinds)


def test_the_cloud_has_every_cell_that_is_not_lost():
    ball = volume()
    cloud = map_cloud(ball, 'base', NS)
    rows = table(cloud)
    assert cloud.header.frame_id == 'base'
    assert (cloud.header.stamp.sec, cloud.header.stamp.nanosec) == (12, 34)
    assert cloud.width == len(rows) == int((ball.grid >= 0).sum())
    assert cloud.row_step == cloud.point_step * cloud.width == len(cloud.data)
    for x, y, z, verdict in rows.tolist():
        # Cell sides are 0.25, 0.5 and 1 m, so this is the distance in cells.
        radius = np.linalg.norm([x / 0.25, y / 0.5, z])
        assert verdict == (1.0 if radius < 2.0 else 0.0)
        assert radius < 3.0


def test_markers_are_cubes_where_a_volume_ends():
    ball = volume()
    (marker,) = map_markers(ball, 'base', NS, 10_000).markers
    assert (marker.scale.x, marker.scale.y, marker.scale.z) == pytest.approx((0.25, 0.5, 1.0))
    radii = [np.linalg.norm([p.x / 0.25, p.y / 0.5, p.z]) for p in marker.points]
    assert max(radii) < 2.0
    # The eight cells in the middle are hidden behind the others.
    assert min(radii) > 0.9
    assert len(radii) == int((ball.grid == 1).sum()) - 8


def test_no_more_markers_than_allowed():
    (marker,) = map_markers(volume(), 'base', NS, 5).markers
    assert 0 < len(marker.points) <= 5


def test_a_slice_shows_all_its_members_as_thin_tiles():
    grid = np.array([[1, -1], [1, 0]], dtype=np.int8)
    frame = MapFrame('xz', np.array([0.0, 0.5, 0.0]), np.eye(3)[[0, 2]])
    tile = FtwsMap('tile', 'digest', 1, 1e-6, frame, np.zeros(2), np.full(2, 2.0), grid)
    (marker,) = map_markers(tile, 'base', NS, 10).markers
    assert [(p.x, p.y, p.z) for p in marker.points] == [(0.5, 0.5, 0.5), (1.5, 0.5, 0.5)]
    assert (marker.scale.x, marker.scale.y, marker.scale.z) == pytest.approx((1.0, 0.1, 1.0))
