"""Node `workspace`: answers whether points are in the fault-tolerant work space, and why not."""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from ft_manip_interfaces.msg import FtwsAnswer
from ft_manip_interfaces.srv import QueryFtws
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.ftws_map import load_map
from ft_manip_ros.core.ftws.query import query, warm_up
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import FtwsResult
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.arm_model import load_arm_parameter
from ft_manip_ros.nodes.ftws_messages import answer_markers, answer_to_message, goals_from_poses
from ft_manip_ros.nodes.managed_node import ManagedNode
from ft_manip_ros.nodes.map_messages import map_cloud, map_markers
from ft_manip_ros.nodes.parameters import ARM_PARAMETERS, ParameterSpec
from ft_manip_ros.nodes.process import run

MODES = ('position', 'pose', 'dextrous')
# Between two slices of a batch the node looks whether it is still wanted.
_SLICE = 32

PARAMETERS = (
    *ARM_PARAMETERS,
    ParameterSpec('frame', 'base_link', 'Frame of the markers: the base of the arm.'),
    ParameterSpec(
        'map',
        '',
        'Map of the arm to show, as `ftmanip ftws ARM --grid ... --map OUT.npz` writes it.',
    ),
    ParameterSpec(
        'time_budget',
        30.0,
        'Time for a batch whose request gives none; what is left then is undecided.',
        's',
        0.001,
        86400.0,
    ),
    ParameterSpec('threads', 2, 'Threads that share the points of a batch.', '', 1, 256),
    ParameterSpec(
        'max_points', 10_000, 'Most points a request may have; ask in batches.', '', 1, 1_000_000
    ),
    ParameterSpec(
        'marker_limit',
        5000,
        'How many answered points stay visible as markers, and cubes of the map.',
        '',
        1,
        1_000_000,
    ),
)


class Workspace(ManagedNode):
    """Answers batches of points or poses, with proof or witness."""

    def __init__(self) -> None:
        # Batches have a thread of their own, so that nothing else waits for them.
        super().__init__('workspace', PARAMETERS, threads=2)

    def configure(self) -> None:
        """Load the arm and open the service."""
        self._chain = load_arm_parameter(self)
        self._time_budget = self.param('time_budget')
        self._max_points = self.param('max_points')
        self._threads = self.param('threads')
        self._frame = self.param('frame')
        self._shown: deque[FtwsAnswer] = deque(maxlen=self.param('marker_limit'))
        self._markers = self.advertise(
            MarkerArray, topics.markers('workspace'), topics.LATCHED_QOS
        )
        self._load_map()
        self.serve(
            QueryFtws, topics.QUERY_FTWS, self._on_query, group=MutuallyExclusiveCallbackGroup()
        )

    def _load_map(self) -> None:
        """Read the map, if there is one to show, and advertise its topics."""
        self._map = load_map(self.param('map'), self._chain) if self.param('map') else None
        if self._map is not None:
            self._map_cloud = self.advertise(PointCloud2, topics.FTWS_MAP, topics.LATCHED_QOS)
            self._map_markers = self.advertise(
                MarkerArray, topics.FTWS_MAP_MARKERS, topics.LATCHED_QOS
            )

    def activate(self) -> None:
        """Show the map."""
        if self._map is None:
            return
        now = self.get_clock().now().nanoseconds
        self._map_cloud.publish(map_cloud(self._map, self._frame, now))
        self._map_markers.publish(
            map_markers(self._map, self._frame, now, self.param('marker_limit'))
        )
        lower, upper = self._map.measure()
        self.get_logger().info(
            f'map of order {self._map.order}: proved between {lower:.4g} and {upper:.4g} '
            f'{self._map.frame.unit}'
        )

    def warm_up(self) -> None:
        """Compile what the first request would wait for."""
        for mode in MODES:
            warm_up(self._chain, mode=mode)

    def _on_query(
        self, request: QueryFtws.Request, response: QueryFtws.Response
    ) -> QueryFtws.Response:
        started = time.perf_counter()
        mode = request.mode or 'position'
        if mode not in MODES:
            raise InputError('mode', f'is {mode!r}; must be one of {", ".join(MODES)}')
        if len(request.poses) > self._max_points:
            raise InputError(
                'poses', f'are {len(request.poses)}; ask for at most {self._max_points} at once'
            )
        for key in ('tolerance', 'time_budget'):
            value = getattr(request, key)
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(key, f'is {value}; must be finite and at least 0')
        settings = FtwsSettings(intervals=request.intervals)
        if request.tolerance > 0.0:
            settings = replace(settings, tolerance=request.tolerance)
        goals = goals_from_poses(request.poses, mode)
        self.get_logger().info(f'judging {len(goals)} points')
        results = self._judge(
            goals, request.order or 1, mode, settings, request.time_budget or self._time_budget
        )
        response.answers = [
            answer_to_message(self._chain, pose, result)
            for pose, result in zip(request.poses, results, strict=True)
        ]
        response.success = True
        response.arm = self._chain.name
        response.joint_names = list(self._chain.joint_names)
        self._shown.extend(response.answers)
        self._markers.publish(
            answer_markers(tuple(self._shown), self._frame, self.get_clock().now().nanoseconds)
        )
        response.elapsed = time.perf_counter() - started
        response.message = f'answered {len(goals)} points in {response.elapsed:.3f} s'
        self.get_logger().info(response.message)
        return response

    def _judge(
        self, goals: list[Goal], order: int, mode: str, settings: FtwsSettings, budget: float
    ) -> list[FtwsResult]:
        deadline = time.perf_counter() + budget
        results: list[FtwsResult] = []
        for first in range(0, max(len(goals), 1), _SLICE):
            # A node that is being deactivated hurries through the rest as undecided.
            left = deadline - time.perf_counter() if self.active else 0.0
            results += query(
                self._chain,
                goals[first : first + _SLICE],
                order=order,
                mode=mode,
                # 0 would mean "never stop".
                settings=replace(settings, time_budget=max(left, 1e-9)),
                threads=self._threads,
            )
        return results


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Workspace, args)


if __name__ == '__main__':
    sys.exit(main())
