"""An arm whose joints follow sines, whose tool is seen, and whose encoders may stick."""

from __future__ import annotations

from collections import deque

import numpy as np

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.detection.feed import MonitorFeed
from ft_manip_ros.core.detection.monitor import FaultMonitor
from ft_manip_ros.core.detection.states import JointState
from ft_manip_ros.core.kinematics import fk


class SeenArm:
    """A monitored arm with a tracker.

    Parameters
    ----------
    rate, tool_rate
        Joint states and poses of the tool a second; ``tool_rate`` divides ``rate``; 0: not seen.
    noise
        Of a coordinate of the tool, m.
    delay
        s by which a pose is older than its stamp.
    late
        s after its stamp at which it comes.
    offset, shift
        Of the point that is seen in the tool's frame, and of the tracker's frame, m.
    turn
        Rotation of the tracker's frame.
    """

    def __init__(
        self,
        arm='paredis_table_3',
        *,
        rate=100.0,
        tool_rate=50.0,
        noise=5e-4,
        delay=0.03,
        late=0.02,
        offset=(0.06, -0.02, 0.1),
        shift=(3.0, -2.0, 1.0),
        turn=None,
        seed=0,
        effort=None,
        encoder_noise=1e-5,
        speed=0.6,
        lag=0.02,
    ):
        self.chain = load_arm(arm)
        self.names = self.chain.joint_names
        self.monitor = FaultMonitor(self.chain.joints, chain=self.chain if tool_rate else None)
        self.feed = MonitorFeed(self.monitor, 'base_link')
        self.rng = np.random.default_rng(seed)
        self.period = 1.0 / rate
        self.every = round(rate / tool_rate) if tool_rate else 0
        self.noise, self.delay, self.late = noise, delay, late
        self.offset, self.shift = np.array(offset), np.array(shift)
        self.turn = np.eye(3) if turn is None else turn
        self.effort = effort
        self.encoder_noise = encoder_noise
        self.lag = lag
        n = self.chain.n
        self.amplitude = 0.3 * np.ones(n)
        self.pace = speed / 0.3 * self.rng.uniform(0.6, 1.4, n)
        self.phase = self.rng.uniform(0.0, 2.0 * np.pi, n)
        self.middle = 0.25 * self.rng.uniform(-1.0, 1.0, n)
        self.locked = {}  # joint: true position
        self.stuck = {}  # joint: reading
        self.slipped = {}  # joint: what its encoder reads too much
        self.rows = []  # what was fed: time, readings, commands, position of the tool or NaN
        self.count = 0
        self.edges = []
        self.mail = []  # (arrival, stamp, position)
        self.truths = deque(maxlen=round(rate))  # (time, true posture) of the last second
        self.change = lambda position: position
        self.frame = 'base_link'

    @property
    def time(self):
        return self.count * self.period

    def command(self, t):
        return self.middle + self.amplitude * np.sin(self.pace * t + self.phase)

    def truth(self, t):
        q = self.command(t - self.lag)
        for joint, stands in self.locked.items():
            q[joint] = stands
        return q

    def lock(self, joint):
        self.locked[joint] = self.truth(self.time)[joint]
        return self.locked[joint]

    def stick(self, joint):
        self.stuck[joint] = self.truth(self.time)[joint]
        return self.stuck[joint]

    def run(self, duration):
        """Feed ``duration`` seconds; returns the new edges."""
        begun = len(self.edges)
        for _ in range(round(duration / self.period)):
            self.count += 1
            t = self.time
            stamp = self.stamp(t)
            self.monitor.command(stamp, dict(zip(self.names, self.command(t), strict=True)))
            self.truths.append((t, self.truth(t)))
            reading = self.truths[-1][1].copy()
            for joint, reads in self.stuck.items():
                reading[joint] = reads
            for joint, more in self.slipped.items():
                reading[joint] += more
            reading += self.encoder_noise * self.rng.standard_normal(self.chain.n)
            efforts = () if self.effort is None else self.effort(self)
            self.edges += self.feed.joint_state(stamp, stamp, self.names, reading, (), efforts)
            if self.every and self.count % self.every == 0:
                self.mail.append((t + self.late, t, self.seen(t - self.delay)))
            tool = self.mail[-1][2] if self.mail and self.mail[-1][1] == t else np.full(3, np.nan)
            self.rows.append((t, reading, self.command(t), tool))
            while self.mail and self.mail[0][0] <= t + 1e-9:
                _, seen_at, position = self.mail.pop(0)
                self.feed.tool_pose(self.stamp(seen_at), stamp, self.frame, position)
        return self.edges[begun:]

    def stamp(self, t):
        return round((t + 100.0) * 1e9)

    def seen(self, t):
        times = [time for time, _ in self.truths]
        k = int(np.clip(np.searchsorted(times, t), 1, len(times) - 1)) if len(times) > 1 else 0
        if k == 0:
            posture = self.truths[0][1]
        else:
            (t0, q0), (t1, q1) = self.truths[k - 1], self.truths[k]
            posture = q0 + np.clip((t - t0) / (t1 - t0), 0.0, 1.0) * (q1 - q0)
        rotation, position = fk(self.chain, posture)
        point = self.turn @ (position + rotation @ self.offset) + self.shift
        return self.change(point + self.noise * self.rng.standard_normal(3))

    def found(self, edges, joint):
        """(seconds from now on, state, cause) of the changes of a joint to a fault."""
        quiet = (JointState.OK, JointState.IDLE, JointState.SUSPECT)
        return [
            (e.stamp * 1e-9 - 100.0, e.report.state, e.report.cause)
            for e in edges
            if e.report.name == self.names[joint] and e.report.state not in quiet
        ]
