"""Synthetic joint data with a known truth, fed to a fault monitor sample by sample."""

from __future__ import annotations

import numpy as np

from ft_manip_ros.core.detection.monitor import FaultMonitor
from ft_manip_ros.core.detection.states import JointState

NAMES = ('a', 'b', 'c')


class Stream:
    """An arm that follows sines a few milliseconds late, unless told otherwise.

    Parameters
    ----------
    rate
        Messages a second.
    noise
        Of the encoders, rad.
    lag
        Seconds by which the joints follow.
    commanded
        Whether references are told.
    """

    def __init__(self, rate=100.0, noise=1e-5, lag=0.02, commanded=True, joints=NAMES, **options):
        self.joints = joints
        self.monitor = FaultMonitor(joints, **options)
        self.period = 1.0 / rate
        self.noise = noise
        self.lag = lag
        self.commanded = commanded
        self.rng = np.random.default_rng(0)
        self.time = 0.0
        self.edges = []
        self.speed = dict.fromkeys(joints, 1.0)  # rad/s of the sines; 0: at rest
        self.held = {}  # joint: true position at which it is locked
        self.phase = dict.fromkeys(joints, 0.0)

    @property
    def stamp(self):
        return round((self.time + 100.0) * 1e9)

    def wanted(self, joint, time):
        """Command: 0.5 sin(w t + joint), w chosen for a peak speed."""
        w = self.speed[joint] / 0.5
        return 0.5 * np.sin(w * time + self.phase[joint])

    def truth(self):
        return {
            joint: self.held.get(joint, self.wanted(joint, self.time - self.lag))
            for joint in self.joints
        }

    def lock(self, joint):
        self.held[joint] = self.truth()[joint]
        return self.held[joint]

    def stop(self, joint):
        """Let the command of a joint rest from now on, smoothly enough for the test."""
        self.phase[joint] += self.speed[joint] / 0.5 * self.time
        self.speed[joint] = 0.0

    def run(self, duration, change=lambda positions: positions, velocities=None, stamp=None):
        """Feed ``duration`` seconds; ``change`` edits each message; returns the new edges."""
        start = len(self.edges)
        for _ in range(round(duration / self.period)):
            self.time += self.period
            if self.commanded:
                commands = {joint: self.wanted(joint, self.time) for joint in self.joints}
                self.monitor.command(self.stamp, commands)
            positions = {
                joint: q + self.noise * self.rng.standard_normal()
                for joint, q in self.truth().items()
            }
            self.edges += self.monitor.sample(
                self.stamp if stamp is None else stamp(self.stamp),
                change(positions),
                velocities(self) if velocities else None,
            )
        return self.edges[start:]

    def states(self):
        return {report.name: report.state for report in self.monitor.states()}

    def alarms(self, edges=None):
        """Names and states of everything that is not healthy."""
        quiet = (JointState.OK, JointState.IDLE, JointState.SUSPECT)
        edges = self.edges if edges is None else edges
        return [(e.report.name, e.report.state) for e in edges if e.report.state not in quiet]
