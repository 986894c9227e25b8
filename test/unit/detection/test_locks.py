"""What is a locked joint, and what only looks like one."""

from __future__ import annotations

import numpy as np
import pytest

from ft_manip_ros.core.detection.monitor import FaultMonitor
from ft_manip_ros.core.detection.settings import MonitorSettings
from ft_manip_ros.core.detection.states import JointState
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.joint import Joint
from support.joint_streams import Stream

LOCKED = JointState.LOCKED


@pytest.mark.parametrize('rate', [10.0, 50.0, 125.0, 1000.0])
@pytest.mark.parametrize('noise', [0.0, 1e-5, 3e-4])
def test_a_lock_is_found_on_the_right_joint_at_every_rate_and_noise(rate, noise):
    stream = Stream(rate=rate, noise=noise)
    stream.run(6.0)
    assert not stream.alarms()
    before = stream.stamp
    angle = stream.lock('b')
    edges = stream.run(1.5)
    assert stream.alarms(edges) == [('b', LOCKED)]
    (lock,) = [edge for edge in edges if edge.report.state == LOCKED]
    assert before < lock.report.first_evidence <= lock.report.confirmed == lock.stamp
    assert lock.report.frozen_position == pytest.approx(angle, abs=1e-4 + 3.0 * noise)
    assert stream.monitor.frozen() == {'b': lock.report.frozen_position}
    if noise:
        error = abs(lock.report.frozen_position - angle)
        # At 10 Hz the motion itself looks like noise, so the noise is overestimated.
        most = 3.0 * noise + (0.0 if rate > 10.0 else 3e-4)
        assert 0.1 * noise < lock.report.frozen_position_sigma < most
        assert error < 1e-4 + 4.0 * lock.report.frozen_position_sigma


def test_a_fast_joint_on_a_good_encoder_is_found_within_a_tenth_of_a_second():
    stream = Stream(rate=250.0)
    stream.run(12.0)
    start = stream.stamp
    stream.lock('a')
    (lock,) = [edge for edge in stream.run(1.0) if edge.report.state == LOCKED]
    assert (lock.stamp - start) * 1e-9 < 0.1


def test_a_resting_joint_is_no_lock_until_it_is_commanded():
    stream = Stream()
    stream.run(5.0)
    stream.stop('c')
    stream.run(2.0)
    stream.lock('c')
    stream.run(20.0)
    assert not stream.alarms()
    assert stream.states()['c'] == JointState.IDLE
    stream.phase['c'] -= stream.time / 0.5
    stream.speed['c'] = 1.0
    stream.held['c'] = stream.truth()['c']
    assert stream.alarms(stream.run(1.0)) == [('c', LOCKED)]


def test_without_commands_long_rests_and_repeats_are_no_lock():
    stream = Stream(commanded=False, noise=0.0)
    for joint in stream.joints:
        stream.speed[joint] = 0.2
    stream.run(10.0, change=rounded)
    stream.stop('b')
    stream.run(10.0, change=rounded)
    assert not stream.alarms()


def rounded(positions):
    return {name: round(q, 4) for name, q in positions.items()}


def sweep(stream, start, height, stuck_from=2.0):
    """Move all joints by ``height`` within a second; 'b' stops dead at a share of the way."""
    for s in np.linspace(0.01, 1.0, 100):
        way = s**3 * (10 - 15 * s + 6 * s * s)
        stream.held = {
            joint: q + height * min(way, stuck_from if joint == 'b' else 1.0)
            for joint, q in start.items()
        }
        stream.run(0.01)
    return dict(stream.held)


def test_without_commands_a_joint_that_stops_dead_among_moving_ones_is_locked():
    stream = Stream(commanded=False)
    stands = dict.fromkeys(stream.joints, 0.0)
    for height in (0.3, -0.3, 0.3, -0.3):
        stands = sweep(stream, stands, height)
        stream.run(0.5)
    assert not stream.alarms()
    stands = sweep(stream, stands, 0.3, stuck_from=0.5)
    assert stream.alarms() == [('b', LOCKED)]
    assert 'stopped dead' in stream.monitor.states()[1].cause


def test_an_arm_that_does_not_execute_its_commands_is_not_locked():
    stream = Stream()
    stream.run(6.0)
    for joint in stream.joints:
        stream.lock(joint)
    stream.run(5.0)
    assert not stream.alarms()
    reports = stream.monitor.states()
    assert any('does not execute' in report.cause for report in reports)
    everything = MonitorSettings(not_executing_joints=0)
    stream = Stream(settings=everything)
    stream.run(6.0)
    for joint in stream.joints:
        stream.lock(joint)
    stream.run(2.0)
    assert set(stream.states().values()) == {LOCKED}


def test_two_locks_among_moving_joints_are_both_found():
    stream = Stream()
    stream.run(6.0)
    stream.lock('a')
    stream.lock('c')
    stream.run(1.0)
    assert stream.states() == {'a': LOCKED, 'b': JointState.OK, 'c': LOCKED}


def test_an_exempt_gripper_is_never_locked():
    stream = Stream(exempt=['c'])
    stream.run(6.0)
    stream.lock('c')
    stream.run(3.0)
    assert not stream.alarms()
    with pytest.raises(InputError, match="exempt: 'finger' is not watched; joints are a, b"):
        FaultMonitor(['a', 'b'], exempt=['finger'])


@pytest.mark.parametrize('lag', [0.0, 0.05, 0.2])
def test_lag_is_learned_and_never_taken_for_a_lock(lag):
    stream = Stream(lag=lag)
    stream.run(12.0)
    assert not stream.alarms()
    record = stream.monitor.records[0]
    assert record['lag_known']
    assert record['lag_low'] - 1e-9 <= lag <= record['lag_high']
    assert record['lag'] == pytest.approx(lag, abs=0.02)


def test_a_slow_start_up_catch_up_is_healthy():
    monitor = FaultMonitor(['a', 'b'])
    edges = []
    q = 0.0
    monitor.trajectory(0, ['a', 'b'], [(0.0, [0.6, 0.0], [], [])])
    for k in range(1, 400):
        if k > 20:  # 200 ms late, then at the servo's own pace
            q += min(0.6 - q, 0.004)
        edges += monitor.sample(k * 10_000_000, {'a': q, 'b': 0.0})
    assert {edge.report.state for edge in edges} <= {0, 1, 2}


def test_backlash_and_creep_are_healthy():
    stream = Stream()
    play = {'a': 0.0}

    def through_play(positions):
        play['a'] = min(max(play['a'], positions['a'] - 0.002), positions['a'] + 0.002)
        return {**positions, 'a': play['a']}

    stream.run(20.0, change=through_play)
    stream.speed['b'] = 0.004
    stream.run(30.0, change=through_play)
    assert not [alarm for alarm in stream.alarms() if alarm[1] == LOCKED]


def test_velocity_that_lives_on_contradicts_a_standing_position():
    stream = Stream(noise=0.0)
    stream.run(6.0)
    stream.lock('a')

    def follows(s):
        w = s.speed['a'] / 0.5
        return {'a': 0.5 * w * np.cos(w * (s.time - s.lag) + s.phase['a'])}

    edges = stream.run(0.4, velocities=follows)
    assert stream.alarms(edges)[0] == ('a', JointState.SENSOR)
    first = next(e for e in edges if e.report.state == JointState.SENSOR)
    assert 'velocity' in first.report.cause


def test_the_tail_of_a_velocity_filter_contradicts_nothing():
    stream = Stream(noise=0.0)
    stream.run(6.0)
    stream.lock('a')
    speed = [1.0]

    def tail(s):
        speed[0] *= 0.95
        return {'a': np.sign(np.cos(2.0 * s.time)) * speed[0]}

    assert stream.alarms(stream.run(0.5, velocities=tail)) == [('a', LOCKED)]


def test_high_effort_lets_a_lock_be_found_sooner():
    found = []
    for effort in (1.0, 10.0):
        stream = Stream(rate=250.0)
        sample = stream.monitor.sample
        push = [1.0]
        stream.monitor.sample = lambda stamp, q, v=None, e=None, s=sample, p=push: s(
            stamp, q, v, dict.fromkeys(q, p[0])
        )
        stream.run(6.0)
        stream.lock('a')
        push[0] = effort
        (lock,) = [edge for edge in stream.run(1.0) if edge.report.state == LOCKED]
        found.append((lock.stamp, 'effort' in lock.report.cause))
    assert found[1][0] <= found[0][0]
    assert [high for _, high in found] == [False, True]


def test_a_lock_that_moves_again_is_a_runaway():
    stream = Stream()
    stream.run(6.0)
    stream.lock('b')
    stream.run(1.0)
    assert stream.states()['b'] == LOCKED
    del stream.held['b']
    stream.run(1.0)
    assert stream.states()['b'] == JointState.RUNAWAY
    report = stream.monitor.states()[1]
    assert np.isnan(report.frozen_position)
    assert not stream.monitor.frozen()


def test_a_wrapping_encoder_is_no_jump_and_freezes_at_its_reading():
    monitor = FaultMonitor(['a', 'b'])
    edges = []
    for k in range(1, 1500):
        t = 0.01 * k
        angle = 1.5 * t if t < 12.0 else 18.0
        wrapped = (angle + np.pi) % (2 * np.pi) - np.pi
        monitor.command(k * 10_000_000, {'a': 1.5 * t, 'b': np.sin(t)})
        edges += monitor.sample(k * 10_000_000, {'a': wrapped, 'b': np.sin(t - 0.01)})
    bad = [(e.report.name, e.report.state) for e in edges if e.report.state > JointState.SUSPECT]
    assert bad == [('a', LOCKED)]
    held = (18.0 + np.pi) % (2 * np.pi) - np.pi
    assert monitor.frozen()['a'] == pytest.approx(held, abs=1e-6)


def test_prismatic_joints_have_thresholds_in_metres():
    slide = Joint('slide', 0.0, 0.5, velocity=0.3, prismatic=True)
    monitor = FaultMonitor([slide, Joint('turn', -2.0, 2.0)])
    edges = []
    for k in range(1, 900):
        t = 0.01 * k
        wanted = 0.2 + 0.1 * np.sin(t)
        q = wanted if t < 8.0 else 0.2 + 0.1 * np.sin(8.0)
        monitor.command(k * 10_000_000, {'slide': wanted, 'turn': np.sin(t)})
        edges += monitor.sample(k * 10_000_000, {'slide': q, 'turn': np.sin(t)})
    assert [e.report.name for e in edges if e.report.state == LOCKED] == ['slide']


@pytest.mark.parametrize(
    ('changes', 'field'),
    [
        ({'sensitivity': 0.0}, 'sensitivity'),
        ({'confirm_s': float('nan')}, 'confirm_s'),
        ({'still_fraction': 0.9}, 'still_fraction'),
        ({'not_executing_joints': -1}, 'not_executing_joints'),
        ({'stale_s': '1'}, 'stale_s'),
    ],
)
def test_settings_that_make_no_sense_are_named(changes, field):
    with pytest.raises(InputError, match=field):
        MonitorSettings(**changes)


def test_joints_must_be_there_and_different():
    with pytest.raises(InputError, match='at least one'):
        FaultMonitor([])
    with pytest.raises(InputError, match='twice'):
        FaultMonitor(['a', 'a'])
