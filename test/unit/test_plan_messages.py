"""Plans as messages: the path that is drawn is the tool's own, from its start to its end."""

from __future__ import annotations

import numpy as np
import pytest

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.goal import rotation_from_quaternion
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.planning.plan import Plan, PlanStatus
from ft_manip_ros.core.planning.trajectory import Trajectory
from ft_manip_ros.nodes.plan_messages import tool_path

ARM = load_arm('paredis_table_3')
START = 5_000_000_000


@pytest.mark.parametrize('count', [1, 2, 150, 777])
def test_the_path_is_the_way_of_the_tool(count):
    rng = np.random.default_rng(count)
    times = np.arange(count) * 0.25
    positions = rng.uniform(ARM.lower, ARM.upper, (count, ARM.n))
    zero = np.zeros_like(positions)
    trajectory = Trajectory(ARM.joint_names, times, positions, zero, zero)
    plan = Plan(PlanStatus.FINISHES, '', {}, {}, (), trajectory)
    path = tool_path(ARM, plan, 'base', START)
    assert path.header.frame_id == 'base'
    assert min(count, 100) <= len(path.poses) <= 200
    rows = []
    for pose in path.poses:
        at = pose.header.stamp.sec + pose.header.stamp.nanosec * 1e-9 - START * 1e-9
        rows.append(round(at / 0.25))
        rotation, position = fk(ARM, positions[rows[-1]])
        place, turn = pose.pose.position, pose.pose.orientation
        np.testing.assert_allclose([place.x, place.y, place.z], position, atol=1e-12)
        turned = rotation_from_quaternion([turn.x, turn.y, turn.z, turn.w], 'path')
        np.testing.assert_allclose(turned, rotation, atol=1e-9)
    assert (rows[0], rows[-1]) == (0, count - 1)
    assert rows == sorted(set(rows))


def test_a_plan_without_motion_has_no_path():
    assert not tool_path(ARM, Plan(PlanStatus.HALTED, '', {}, {}, ()), 'base', START).poses
