"""Samples that cannot be believed, that do not come, and time that does not run forward."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ft_manip_ros.core.detection.monitor import FaultMonitor
from ft_manip_ros.core.detection.states import JointState
from ft_manip_ros.core.joint import Joint
from support.joint_streams import Stream

LOCKED, STALE, SENSOR = JointState.LOCKED, JointState.STALE, JointState.SENSOR


@pytest.mark.parametrize('nonsense', [math.nan, math.inf, 253.0, 1e184])
def test_nonsense_is_a_sensor_fault_and_moves_no_estimate(nonsense):
    stream = Stream()
    stream.run(4.0)
    believed = stream.monitor.states()[1].position
    edges = stream.run(0.2, change=lambda q: {**q, 'b': nonsense})
    assert stream.alarms(edges) == [('b', SENSOR)]
    assert stream.monitor.states()[1].position == believed
    stream.run(1.0)
    assert stream.states()['b'] == JointState.OK


def test_positions_outside_the_physical_range_are_not_believed():
    monitor = FaultMonitor([Joint('a', -1.0, 1.0), Joint('b')])
    for k in range(1, 50):
        monitor.sample(k * 10_000_000, {'a': 0.5, 'b': 0.0})
    (edge,) = monitor.sample(500_000_000, {'a': 1.3, 'b': 0.0})
    assert (edge.report.state, edge.report.position) == (SENSOR, 0.5)
    assert 'range' in edge.report.cause


def test_scattered_all_zero_messages_are_not_believed():
    stream = Stream()
    stream.run(4.0)
    count = iter(range(10_000))

    def sometimes_zero(positions):
        return dict.fromkeys(positions, 0.0) if next(count) % 37 == 5 else positions

    edges = stream.run(4.0, change=sometimes_zero)
    assert {state for _, state in stream.alarms(edges)} == {SENSOR}
    stream.run(0.5)
    assert set(stream.states().values()) == {JointState.OK}


def test_a_lock_is_found_although_every_fiftieth_sample_is_nan():
    stream = Stream()
    stream.run(6.0)
    stream.lock('b')
    count = iter(range(10_000))
    stream.run(1.0, change=lambda q: {**q, 'b': math.nan} if next(count) % 50 == 0 else q)
    assert stream.states()['b'] == LOCKED


def test_a_jump_that_stays_is_believed_after_a_while():
    stream = Stream()
    stream.run(4.0)
    edges = stream.run(1.0, change=lambda q: {**q, 'c': q['c'] + 2.0})
    assert stream.alarms(edges)[0] == ('c', SENSOR)
    assert stream.states()['c'] == JointState.OK
    assert stream.monitor.states()[2].position == pytest.approx(
        stream.truth()['c'] + 2.0, abs=1e-3
    )


def test_a_flickering_encoder_that_repeats_bit_for_bit_is_dead_but_not_locked():
    stream = Stream(rate=100.0)
    stream.run(3.0)
    for joint in stream.joints:
        stream.stop(joint)
    stream.run(8.0)
    assert not stream.alarms()
    stuck = stream.truth()['a']
    edges = stream.run(0.3, change=lambda q: {**q, 'a': stuck})
    assert stream.alarms(edges) == [('a', SENSOR)]
    assert 'bit for bit' in stream.monitor.states()[0].cause


def test_rounded_positions_that_repeat_for_seconds_are_healthy():
    stream = Stream()
    rounded = lambda q: {name: round(x, 4) for name, x in q.items()}  # noqa: E731
    stream.run(3.0, change=rounded)
    for joint in stream.joints:
        stream.stop(joint)
    stream.run(30.0, change=rounded)
    assert not stream.alarms()


def test_an_arm_without_noise_may_repeat_itself_at_rest():
    stream = Stream(noise=0.0)
    stream.run(8.0)
    for joint in stream.joints:
        stream.stop(joint)
    stream.run(8.0)
    assert not stream.alarms()


def test_an_encoder_that_does_not_exist_is_no_lock():
    stream = Stream()
    silent = lambda q: {**q, 'c': 0.0}  # noqa: E731
    for joint in stream.joints:
        stream.stop(joint)
    stream.run(1.0, change=silent)
    for joint in stream.joints:
        stream.phase[joint] = -2.0 * stream.time
        stream.speed[joint] = 1.0
    stream.run(2.0, change=silent)
    assert stream.states()['c'] == SENSOR
    assert 'exactly zero ever since' in stream.monitor.states()[2].cause


def test_a_joint_that_is_missing_is_stale_and_never_locked():
    stream = Stream()
    stream.run(6.0)

    def without_b(positions):
        return {name: q for name, q in positions.items() if name != 'b'}

    edges = stream.run(5.0, change=without_b)
    assert stream.alarms(edges) == [('b', STALE)]
    assert 0.1 < (edges[-1].stamp - 106_000_000_000) * 1e-9 < 0.4
    stream.run(1.0)
    assert not stream.alarms(stream.run(1.0))
    assert stream.states()['b'] == JointState.OK


def test_a_joint_that_never_reports_is_stale():
    monitor = FaultMonitor(['a', 'b'])
    for k in range(1, 200):
        monitor.sample(k * 10_000_000, {'a': 0.001 * k})
    assert monitor.states()[1].state == STALE


def test_each_of_two_publishers_with_a_subset_of_the_joints_is_healthy():
    stream = Stream()
    turn = iter(range(100_000))

    def alternately(positions):
        mine = ('a',) if next(turn) % 2 else ('b', 'c')
        return {name: positions[name] for name in mine}

    stream.run(12.0, change=alternately)
    assert not stream.alarms()
    stream.lock('c')
    stream.run(1.0, change=alternately)
    assert stream.alarms() == [('c', LOCKED)]


@pytest.mark.parametrize('behind', [0, -3_000_000_000])
def test_stamps_that_repeat_or_go_back_are_stale_and_hold_everything(behind):
    stream = Stream()
    stream.run(6.0)
    believed = [report.position for report in stream.monitor.states()]
    frozen = stream.stamp + behind
    edges = stream.run(0.5, stamp=lambda now: frozen)
    assert {state for _, state in stream.alarms(edges)} == {STALE}
    assert [report.position for report in stream.monitor.states()] == believed
    stream.run(1.0)
    assert set(stream.states().values()) == {JointState.OK}


def test_a_payload_that_freezes_while_stamps_advance_is_stale_and_no_lock():
    stream = Stream()
    stream.run(8.0)
    last = {}

    def frozen(positions):
        if not last:
            last.update(positions)
        return dict(last)

    edges = stream.run(3.0, change=frozen)
    assert {state for _, state in stream.alarms(edges)} == {STALE}
    stream.run(2.0)
    assert LOCKED not in stream.states().values()


def test_messages_lost_and_reordered_change_nothing():
    stream = Stream()
    rng = np.random.default_rng(2)
    sample = stream.monitor.sample
    waiting = []

    def lossy(stamp, *data):
        if rng.random() < 0.02:
            return []
        if rng.random() < 0.02 and not waiting:
            waiting.append((stamp, *data))
            return []
        edges = sample(stamp, *data)
        while waiting:
            edges += sample(*waiting.pop())
        return edges

    stream.monitor.sample = lossy
    stream.run(30.0)
    assert not stream.alarms()
    stream.lock('a')
    stream.run(1.0)
    assert stream.alarms() == [('a', LOCKED)]


def test_a_new_time_line_resets_cleanly_and_keeps_faults():
    stream = Stream()
    stream.run(6.0)
    stream.lock('b')
    stream.run(1.0)
    assert stream.states()['b'] == LOCKED
    stream.time = -50.0  # a bag that begins again
    edges = stream.run(3.0)
    assert {state for _, state in stream.alarms(edges)} <= {STALE}
    assert stream.states() == {'a': JointState.OK, 'b': LOCKED, 'c': JointState.OK}
    stream.lock('a')
    stream.run(1.0)
    assert stream.states()['a'] == LOCKED


def test_a_gap_of_seconds_is_no_evidence():
    stream = Stream()
    stream.run(6.0)
    for _ in range(5):
        stream.time += 3.0
        stream.run(2.0)
    assert not stream.alarms()


def test_a_joint_that_swings_away_from_its_command_is_a_runaway():
    stream = Stream()
    stream.run(6.0)
    start = stream.time
    edges = stream.run(1.5, change=lambda q: {**q, 'b': q['b'] + (stream.time - start) ** 2})
    assert stream.alarms(edges) == [('b', JointState.RUNAWAY)]
    assert not stream.monitor.frozen()


def test_a_brake_that_slips_at_rest_is_a_runaway_and_slow_creep_is_not():
    stream = Stream()
    stream.run(4.0)
    for joint in stream.joints:
        stream.stop(joint)
    stream.run(4.0)
    start = stream.time
    stream.run(20.0, change=lambda q: {**q, 'a': q['a'] + 0.004 * (stream.time - start)})
    assert not stream.alarms()
    stream.run(3.0, change=lambda q: {**q, 'a': q['a'] + 0.08 + 0.1 * (stream.time - start - 20)})
    assert stream.alarms() == [('a', JointState.RUNAWAY)]


def test_a_joint_that_follows_ever_later_is_sluggish_and_nothing_worse():
    stream = Stream()
    stream.run(20.0)
    lag = [stream.lag]

    def later(positions):
        lag[0] = min(lag[0] + 0.002, 0.25)
        return {**positions, 'b': stream.wanted('b', stream.time - lag[0])}

    edges = stream.run(15.0, change=later)
    assert stream.alarms(edges) == [('b', JointState.SLUGGISH)]
    assert 'later' in stream.monitor.states()[1].cause


def feed_jerks(stream, duration, first, last=math.inf, grow=1.0):
    """Let joint b stand until it is ``first`` rad late, and jump; then ever later, to ``last``."""
    stands, late = [stream.truth()['b']], [first]

    def by_jerks(positions):
        if abs(positions['b'] - stands[0]) > late[0]:
            stands[0] = positions['b']
            late[0] = min(late[0] * grow, last)
        return {**positions, 'b': stands[0]}

    return stream.run(duration, change=by_jerks)


def test_a_joint_that_follows_by_jerks_is_sluggish_and_nothing_worse():
    stream = Stream(rate=250.0, noise=1e-6)
    stream.speed['b'] = 0.15
    stream.run(10.0)
    begin = stream.stamp
    edges = feed_jerks(stream, 5.0, 0.0065)
    assert set(stream.alarms(edges)) == {('b', JointState.SLUGGISH)}
    first = next(edge for edge in edges if edge.report.state == JointState.SLUGGISH)
    assert 'jerks' in first.report.cause
    # Four jerks of 43 ms tell, and one more may be going on.
    assert first.stamp - begin < 0.22e9


@pytest.mark.parametrize('rate', [100.0, 250.0, 1000.0])
def test_jerks_that_grow_beyond_every_slack_are_never_a_lock(rate):
    stream = Stream(rate=rate, noise=1e-6)
    stream.speed['b'] = 0.3
    stream.run(10.0)
    edges = feed_jerks(stream, 12.0, 0.003, last=0.03, grow=1.03)
    # In the end it stands still for 0.1 s at a time.
    assert set(stream.alarms(edges)) == {('b', JointState.SLUGGISH)}


def test_jerks_that_end_in_a_lock_are_a_lock():
    stream = Stream(rate=250.0, noise=1e-6)
    stream.speed['b'] = 0.3
    stream.run(10.0)
    feed_jerks(stream, 12.0, 0.003, last=0.01, grow=1.03)
    truth = stream.lock('b')
    edges = stream.run(2.0)
    assert stream.alarms(edges)[-1] == ('b', JointState.LOCKED)
    assert abs(stream.monitor.frozen()['b'] - truth) < 1e-4


@pytest.mark.parametrize('rate', [20.0, 100.0, 1000.0])
def test_a_joint_that_swings_freely_while_commanded_to_rest_is_a_runaway(rate):
    stream = Stream(rate=rate)
    stream.run(4.0)
    for joint in stream.joints:
        stream.stop(joint)
    stream.run(4.0)
    start = stream.time

    def swing(positions):
        # A link hangs down and swings about 0.2 rad beside where it was held.
        time = stream.time - start
        way = 0.2 * (1.0 - math.exp(-0.2 * time) * math.cos(2.0 * math.pi * time))
        return {**positions, 'b': positions['b'] + way}

    edges = stream.run(6.0, change=swing)
    assert stream.alarms(edges) == [('b', JointState.RUNAWAY)]
    assert 'commanded to rest' in stream.monitor.states()[1].cause
    assert not stream.monitor.frozen()
    # Seen before it has swung through a fourth.
    assert edges[-1].stamp - (start + 100.0) * 1e9 < 0.3e9
