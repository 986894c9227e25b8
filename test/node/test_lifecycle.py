"""Every node: transitions by `ros2 lifecycle`'s services, bad parameters, and a prompt end."""

from __future__ import annotations

import signal

import pytest
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState

pytestmark = pytest.mark.node

NODES = ('arm_sim', 'fault_monitor', 'replanner', 'workspace', 'designer', 'recorder')
ARM_NODES = ('arm_sim', 'fault_monitor', 'replanner', 'workspace')


def change(probe, name, transition):
    request = ChangeState.Request()
    request.transition.id = transition
    return probe.call(ChangeState, f'{name}/change_state', request).success


def state(probe, name):
    return probe.call(GetState, f'{name}/get_state', GetState.Request()).current_state.id


def settings(name, tmp_path):
    """Parameters that keep a node from working by itself."""
    return {'recorder': {'output': str(tmp_path / 'bag')}}.get(name, {})


@pytest.mark.parametrize('name', NODES)
def test_walks_through_its_states_twice(name, start_node, probe, tmp_path):
    start_node(name, params={'autostart': False, **settings(name, tmp_path)})
    assert state(probe, name) == State.PRIMARY_STATE_UNCONFIGURED
    # Impossible from here: refused, answered, survived.
    assert not change(probe, name, Transition.TRANSITION_ACTIVATE)
    for k in range(2):
        assert change(probe, name, Transition.TRANSITION_CONFIGURE)
        assert state(probe, name) == State.PRIMARY_STATE_INACTIVE
        assert change(probe, name, Transition.TRANSITION_ACTIVATE)
        assert state(probe, name) == State.PRIMARY_STATE_ACTIVE
        assert change(probe, name, Transition.TRANSITION_DEACTIVATE)
        assert change(probe, name, Transition.TRANSITION_CLEANUP)
        assert state(probe, name) == State.PRIMARY_STATE_UNCONFIGURED
        if name == 'recorder':
            # It never writes over a bag.
            (tmp_path / 'bag').rename(tmp_path / f'bag_{k}')
    assert change(probe, name, Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)
    assert state(probe, name) == State.PRIMARY_STATE_FINALIZED


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('name', NODES)
def test_activates_itself_and_ends_at_once(name, number, start_node, probe, tmp_path):
    node = start_node(name, params=settings(name, tmp_path))
    active = State.PRIMARY_STATE_ACTIVE
    probe.until(lambda: state(probe, name) == active, 60.0, f'{name} active')
    # By force after 1.5 s if need be, and then with this exit code; but a bag is finished.
    by_force = () if name == 'recorder' else (128 + number,)
    assert node.stop(number) in (0, *by_force)
    assert not node.members()


@pytest.mark.parametrize('name', ARM_NODES)
def test_an_arm_it_cannot_load_leaves_it_unconfigured_and_alive(name, start_node, probe):
    node = start_node(name, params={'arm': 'no_such_arm'})
    line = node.wait_for('no_such_arm')
    assert 'paredis_table_3' in node.output, line
    assert state(probe, name) == State.PRIMARY_STATE_UNCONFIGURED
    assert node.running


@pytest.mark.parametrize('value', ['200000.0', 'fast'])
def test_a_parameter_out_of_range_or_of_another_type_is_named(value, start_node):
    node = start_node('arm_sim', '--ros-args', '-p', f'rate:={value}')
    assert node.wait(30.0) == 2
    assert 'rate' in node.output
