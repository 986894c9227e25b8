"""Compile the kernels ahead of the first message."""

from __future__ import annotations

import math

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.detection.monitor import FaultMonitor

_STEP = 10_000_000  # ns


def warm_up(chain: SerialChain | None = None) -> None:
    """Run every compiled kernel once, on an arm of two joints; with a chain the tool's, too."""
    monitor = FaultMonitor(['a', 'b'])
    monitor.trajectory(0, ['a', 'b'], [(0.5, [1.0, 1.0], [], [])])
    for k in range(20):
        monitor.sample(k * _STEP, {'a': 0.0, 'b': 0.001 * k}, {'a': math.nan}, {'a': 0.0})
    monitor.freeze('a', None, '', 20 * _STEP)
    monitor.clear('a', 20 * _STEP)
    if chain is not None:
        watch = FaultMonitor(chain.joints, chain=chain).tool
        assert watch is not None
        watch.warm_up()
