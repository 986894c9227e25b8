"""Healthy joints that look locked for a moment, and the locks found all the same."""

from __future__ import annotations

import numpy as np
import pytest

from ft_manip_ros.core.detection.monitor import FaultMonitor
from ft_manip_ros.core.detection.states import JointState
from support.joint_streams import Stream

LOCKED = JointState.LOCKED
NAMES = ('a', 'b', 'c')
RATE = 100.0  # Hz


def smooth(s):
    s = np.clip(s, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s * s)


def play(x, half):
    """Output behind a play of ``half`` to either side."""
    out = np.empty_like(x)
    at = x[0]
    for k, value in enumerate(x):
        at = min(max(at, value - half), value + half)
        out[k] = at
    return out


def judge(times, commands, positions):
    """Feed a recording with streamed references; return the edges that are no healthy ones."""
    monitor = FaultMonitor(NAMES[: positions.shape[1]])
    rng = np.random.default_rng(0)
    edges = []
    for t, c, q in zip(times, commands, positions, strict=True):
        stamp = round((t + 100.0) * 1e9)
        monitor.command(stamp, dict(zip(monitor.names, c, strict=True)))
        noisy = q + 1e-5 * rng.standard_normal(len(q))
        edges += monitor.sample(stamp, dict(zip(monitor.names, noisy, strict=True)))
    return [(e.report.name, e.report.state) for e in edges if e.report.state > JointState.SUSPECT]


@pytest.mark.parametrize('half', [0.0, 0.008])
@pytest.mark.parametrize('lag', [0.05, 0.2, 0.28])
def test_a_joint_that_trails_quick_ones_and_rests_late_at_its_goals_is_healthy(lag, half):
    times = np.arange(0.0, 11.0, 1.0 / RATE)
    wanted = np.zeros_like(times)
    goal, start = 0.0, 1.0
    for new, length in ((1.0, 1.5), (-0.5, 1.0), (0.8, 3.0), (0.2, 0.8)):
        wanted += (new - goal) * smooth((times - start) / length)
        goal, start = new, start + length + 0.8
    late = play(np.interp(times - lag, times, wanted), half)
    quick = np.interp(times - 0.01, times, wanted)
    commands = np.column_stack((wanted, wanted, wanted))
    assert judge(times, commands, np.column_stack((late, quick, quick))) == []


def test_a_load_that_hides_slow_motion_for_a_moment_is_no_lock():
    times = np.arange(0.0, 20.0, 1.0 / RATE)
    for speed in (0.01, 0.02, 0.037):
        wanted = 0.3 * smooth((times - 1.0) / 2.0) - 0.3 * smooth((times - 4.0) / 2.0)
        wanted += speed * np.clip(times - 10.0, 0.0, 8.0)
        # A payload of one degree, taken up within half a second against the motion.
        sag = -np.deg2rad(0.5) * np.tanh(4.4 * (times - 14.0))
        positions = np.column_stack((np.interp(times - 0.02, times, wanted) + sag, wanted))
        assert judge(times, np.column_stack((wanted, wanted)), positions) == []


class Trajectories:
    """An arm that takes its trajectories up late; the monitor hears of them at once."""

    def __init__(self, seed=0):
        self.rng = np.random.default_rng(seed)
        self.monitor = FaultMonitor(NAMES)
        self.time = 100.0
        self.stands = np.zeros(3)
        self.locked = {}
        self.edges = []
        self.monitor.sample(round(99.99 * 1e9), dict.fromkeys(NAMES, 0.0))

    def move(self, goal, length=1.5, late=0.0, rest=1.0):
        goal = np.asarray(goal, dtype=float)
        point = (length, list(goal), [0.0] * 3, [])
        self.monitor.trajectory(round(self.time * 1e9), NAMES, [point])
        start = self.stands.copy()
        new = len(self.edges)
        for k in range(1, round((length + rest) * RATE) + 1):
            s = np.clip((k / RATE - late - 0.02) / length, 0.0, 1.0)
            q = start + (goal - start) * s * s * (3.0 - 2.0 * s)
            for j, angle in self.locked.items():
                q[j] = angle
            self.time += 1.0 / RATE
            noisy = q + 1e-5 * self.rng.standard_normal(3)
            stamp = round(self.time * 1e9)
            self.edges += self.monitor.sample(stamp, dict(zip(NAMES, noisy, strict=True)))
            self.stands = q
        return self.edges[new:]

    def alarms(self):
        return [
            (e.report.name, e.report.state)
            for e in self.edges
            # Later than usual is what they are.
            if e.report.state > JointState.SUSPECT and e.report.state != JointState.SLUGGISH
        ]


@pytest.mark.parametrize('late', [0.1, 0.2, 0.5])
def test_an_arm_that_takes_up_a_trajectory_late_is_healthy_and_its_lock_is_found(late):
    for seed in range(6):
        arm = Trajectories(seed)
        for _ in range(3):
            arm.move(arm.rng.uniform(-1.0, 1.0, 3))
        # Joints of very different speeds, so that some seem to move long before others.
        arm.move(arm.stands + np.array([0.9, 0.1, -0.3]), late=late)
        assert arm.alarms() == []
        arm.locked[1] = arm.stands[1]
        arm.move(arm.stands + np.array([-0.5, 0.4, 0.3]), late=late)
        assert arm.alarms() == [('b', LOCKED)]


def test_a_trajectory_that_nobody_takes_up_is_said_to_be_so_and_locks_nobody():
    arm = Trajectories()
    arm.move([0.5, -0.5, 0.3])
    arm.locked = dict(enumerate(arm.stands))
    edges = arm.move([0.0, 0.0, 0.0], rest=3.0)
    assert arm.alarms() == []
    assert {e.report.state for e in edges} >= {JointState.SUSPECT}
    causes = [report.cause for report in arm.monitor.states()]
    assert any('does not execute' in cause for cause in causes)


def test_a_lone_commanded_joint_that_never_moves_is_found_once_the_arm_had_its_time():
    arm = Trajectories()
    arm.move([0.5, -0.5, 0.3])
    arm.locked[0] = arm.stands[0]
    asked = arm.time
    edges = arm.move(arm.stands + np.array([0.4, 0.0, 0.0]))
    (lock,) = [edge for edge in edges if edge.report.state == LOCKED]
    assert lock.report.name == 'a'
    assert 1.0 < lock.stamp * 1e-9 - asked < 1.5
    assert arm.alarms() == [('a', LOCKED)]


def test_a_lone_joint_that_takes_its_trajectory_up_late_is_healthy():
    arm = Trajectories()
    arm.move([0.5, -0.5, 0.3])
    arm.move(arm.stands + np.array([0.4, 0.0, 0.0]), late=0.6)
    assert arm.alarms() == []


def test_a_lone_joint_that_stops_on_its_way_is_found_at_once():
    arm = Trajectories()
    for _ in range(3):
        arm.move(arm.rng.uniform(-1.0, 1.0, 3))
    home = arm.stands.copy()
    arm.locked[0] = home[0] + 0.2  # half way, reached by a leap that its speed allows
    sample, begin = arm.monitor.sample, arm.time

    def until_half_way(stamp, positions):
        s = np.clip((stamp * 1e-9 - begin - 0.02) / 1.5, 0.0, 0.5)
        return sample(stamp, {**positions, 'a': home[0] + 0.4 * s * s * (3.0 - 2.0 * s)})

    arm.monitor.sample = until_half_way
    edges = arm.move(home + np.array([0.4, 0.0, 0.0]))
    (lock,) = [edge for edge in edges if edge.report.state == LOCKED]
    assert 0.77 < lock.stamp * 1e-9 - begin < 0.92


def test_a_joint_that_stops_on_its_way_is_found_sooner_than_one_that_does_not_start():
    found = []
    for rest in (0.0, 3.0):
        stream = Stream(rate=250.0)
        stream.run(12.0)
        if rest:
            stream.stop('a')
            stream.run(rest)
            stream.phase['a'] -= stream.time / 0.5
            stream.speed['a'] = 1.0
        stream.lock('a')
        start = stream.stamp
        (lock,) = [edge for edge in stream.run(1.0) if edge.report.state == LOCKED]
        found.append((lock.stamp - start) * 1e-9)
    assert found[0] < found[1]
    assert found[0] < 0.06
