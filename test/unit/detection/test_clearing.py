"""Faults by hand, clearing, proof of health, and the state file."""

from __future__ import annotations

import json
import math

import pytest

from ft_manip_ros.core.detection.monitor import FaultMonitor
from ft_manip_ros.core.detection.state_file import restore_faults, save_faults
from ft_manip_ros.core.detection.states import JointState
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.joint import Joint
from support.joint_streams import Stream


def locked_stream():
    stream = Stream()
    stream.run(6.0)
    stream.lock('b')
    stream.run(1.0)
    assert stream.states()['b'] == JointState.LOCKED
    return stream


def test_only_an_explicit_clear_ends_a_lock_and_the_joint_must_prove_itself():
    stream = locked_stream()
    stream.run(5.0)
    assert stream.states()['b'] == JointState.LOCKED
    # Released while the command passes where it stands: no jump.
    while abs(stream.wanted('b', stream.time - stream.lag) - stream.held['b']) > 0.01:
        stream.run(0.01)
    del stream.held['b']
    (edge,) = stream.monitor.clear('b', stream.stamp, 'brake released')
    assert (edge.previous, edge.report.state) == (JointState.LOCKED, JointState.PROVING)
    assert 'brake released' in edge.report.cause
    assert math.isnan(edge.report.frozen_position)
    edges = stream.run(3.0)
    first = next(e for e in edges if e.report.name == 'b')
    assert (first.previous, first.report.state) == (JointState.PROVING, JointState.OK)


def test_a_joint_cleared_too_early_is_locked_again_at_once():
    stream = locked_stream()
    stream.monitor.clear('', stream.stamp)
    assert stream.states()['b'] == JointState.PROVING
    stream.run(1.0)
    assert stream.states()['b'] == JointState.LOCKED


def test_a_cleared_joint_at_rest_has_proved_nothing():
    stream = locked_stream()
    for joint in stream.joints:
        stream.stop(joint)
    stream.run(2.0)
    stream.monitor.clear('b', stream.stamp)
    stream.run(20.0)
    assert stream.states()['b'] == JointState.PROVING


def test_a_joint_is_frozen_by_hand_where_told_or_where_it_stands():
    stream = Stream()
    stream.run(2.0)
    edge = stream.monitor.freeze('a', None, 'operator', stream.stamp)
    assert edge.report.state == JointState.LOCKED
    assert edge.report.manual
    assert edge.report.frozen_position == pytest.approx(stream.truth()['a'], abs=1e-4)
    edge = stream.monitor.freeze('c', 0.75, 'operator', stream.stamp)
    assert stream.monitor.frozen()['c'] == 0.75
    stream.run(3.0)  # goes on moving: the operator's word stands
    assert stream.states()['c'] == JointState.LOCKED
    assert stream.monitor.clear('', stream.stamp) and not stream.monitor.frozen()


def test_freezing_and_clearing_refuse_nonsense():
    monitor = FaultMonitor(['a', 'b'])
    with pytest.raises(InputError, match="'x' is not watched; joints are a, b"):
        monitor.freeze('x', 0.0, '', 0)
    with pytest.raises(InputError, match='finite'):
        monitor.freeze('a', math.nan, '', 0)
    with pytest.raises(InputError, match='never measured'):
        monitor.freeze('a', None, '', 0)
    with pytest.raises(InputError, match='not watched'):
        monitor.clear('x', 0)
    assert monitor.clear('a', 0) == []


def test_freezing_refuses_what_no_joint_can_stand_at():
    turning, endless = Joint('a', -2.0, 2.0), Joint('b', -math.pi, math.pi)
    monitor = FaultMonitor([turning, endless])
    with pytest.raises(InputError, match="position: is 1000; 'a' stands between -2 and 2"):
        monitor.freeze('a', 1000.0, '', 0)
    assert not monitor.frozen()
    with pytest.raises(InputError, match=r'position: is 2\.3;'):
        monitor.freeze('a', 2.3, '', 0)
    # Calibration may be off, and a lock happens where it happens.
    monitor.freeze('a', 2.1, '', 0)
    monitor.freeze('b', 7.0, '', 0)  # turns on and on
    assert monitor.frozen() == {'a': 2.1, 'b': 7.0}


def test_faults_survive_in_the_state_file(tmp_path):
    stream = locked_stream()
    stream.monitor.freeze('c', 0.5, 'by hand', stream.stamp)
    path = tmp_path / 'deep' / 'faults.json'
    save_faults(path, 'arm', stream.monitor.states())
    fresh = FaultMonitor(stream.joints)
    assert sorted(restore_faults(path, fresh)) == ['b', 'c']
    assert fresh.frozen() == stream.monitor.frozen()
    b, c = fresh.states()[1:]
    assert (b.manual, c.manual) == (False, True)
    assert 'restored' in b.cause
    assert b.frozen_position_sigma == stream.monitor.states()[1].frozen_position_sigma
    assert [entry.name for entry in path.parent.iterdir()] == ['faults.json']
    save_faults(path, 'arm', FaultMonitor(stream.joints).states())
    assert restore_faults(path, FaultMonitor(stream.joints)) == []
    assert restore_faults(tmp_path / 'none.json', fresh) == []


@pytest.mark.parametrize(
    'content',
    ['', '{', '[]', '{"version": 9, "faults": []}', '{"version": 1, "faults": [{"joint": "a"}]}'],
)
def test_a_state_file_that_cannot_be_read_is_named(tmp_path, content):
    path = tmp_path / 'faults.json'
    path.write_text(content)
    with pytest.raises(InputError, match=r'faults\.json: is no state file'):
        restore_faults(path, FaultMonitor(['a']))


def test_a_state_file_of_another_arm_is_refused(tmp_path):
    path = tmp_path / 'faults.json'
    monitor = FaultMonitor(['elbow'])
    monitor.freeze('elbow', 0.1, '', 0)
    save_faults(path, 'other', monitor.states())
    assert json.loads(path.read_text())['faults'][0]['position'] == 0.1
    with pytest.raises(InputError, match="'elbow' is not watched; joints are a, b"):
        restore_faults(path, FaultMonitor(['a', 'b']))
