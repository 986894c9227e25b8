"""The base of all nodes, in this process: transitions, releases, refusals."""

from __future__ import annotations

import math
import re

import pytest
import rclpy
from lifecycle_msgs.msg import State
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from ft_manip_ros.core.errors import InputError
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.managed_node import ManagedNode
from ft_manip_ros.nodes.parameters import ParameterSpec

pytestmark = pytest.mark.node

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
PARAMETERS = (
    ParameterSpec('autonomy', 1.5, 'Some number without a range.', 's'),
    ParameterSpec('flavour', 'sweet', 'Some word.', choices=('sweet', 'sour')),
    ParameterSpec('fail_at', '', 'Which step raises.'),
    ParameterSpec('numbers', Parameter.Type.DOUBLE_ARRAY, 'Some numbers.', 'm'),
)


class Plain(ManagedNode):
    """A node with one of everything."""

    def __init__(self, autostart=False):
        self.heard, self.steps = [], []
        super().__init__('plain', PARAMETERS)

    def _step(self, name):
        self.steps.append(name)
        if self.param('fail_at') == name:
            raise InputError(name, 'was told to fail')
        if self.param('fail_at') == f'{name}!':
            raise ZeroDivisionError(name)

    def configure(self):
        self.publisher = self.advertise(Float64, 'out', topics.LATCHED_QOS)
        self.subscribe(Float64, 'out', self._on_number, topics.LATCHED_QOS)
        self.serve(Trigger, 'plain/go', self._on_go)
        self.every(0.01, lambda: self.publisher.publish(Float64(data=1.0)))
        self.param('autonomy'), self.param('flavour'), self.param('numbers')
        self._step('configure')

    def warm_up(self):
        self._step('warm_up')

    def activate(self):
        self._step('activate')

    def deactivate(self):
        self._step('deactivate')

    def release(self):
        self._step('release')

    def _on_number(self, message):
        if message.data < 0.0:
            raise InputError('data', 'is negative')
        self.heard.append(message.data)

    def _on_go(self, request, response):
        raise InputError('go', 'not now')


@pytest.fixture
def make(ros_domain):
    """Make nodes in this process's own ROS context; all are destroyed afterwards."""
    made = []

    def make(**parameters):
        arguments = ['--ros-args', '-p', 'autostart:=false']
        for name, value in parameters.items():
            arguments += ['-p', f'{name}:={value}']
        rclpy.init(args=arguments, domain_id=ros_domain)
        node = Plain()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        made.append((node, executor))
        return node, executor

    yield make
    for node, executor in made:
        executor.shutdown()
        node.destroy_node()
    rclpy.try_shutdown()


def state(node):
    return node._state_machine.current_state[0]


def spin(executor, until, times=300):
    for _ in range(times):
        if until():
            return True
        executor.spin_once(timeout_sec=0.02)
    return False


def test_everything_made_is_released_however_often(make, capfd):
    node, _ = make()
    permanent = len(node._entities())
    for _ in range(3):
        assert node.trigger_configure() == SUCCESS
        assert len(node._entities()) == permanent + 4
        assert node.trigger_activate() == SUCCESS
        assert node.trigger_deactivate() == SUCCESS
        assert node.trigger_cleanup() == SUCCESS
        assert len(node._entities()) == permanent
    assert node.steps == ['configure', 'warm_up', 'activate', 'deactivate', 'release'] * 3
    # Whoever asked for a transition, the log says that it was made.
    logged = re.findall(r'\]: (.*)', capfd.readouterr().err)
    assert logged == ['configuring', 'configured', 'active', 'deactivated', 'cleaned up'] * 3


@pytest.mark.parametrize('step', ['configure', 'warm_up', 'configure!', 'warm_up!'])
def test_a_failed_configuration_leaves_it_unconfigured_and_released(make, step, capfd):
    node, _ = make(fail_at=step)
    permanent = len(node._entities())
    assert node.trigger_configure() == FAILURE
    assert state(node) == State.PRIMARY_STATE_UNCONFIGURED
    assert len(node._entities()) == permanent
    assert node.steps[-1] == 'release'
    said = capfd.readouterr().err
    assert ('told to fail' in said) != ('ZeroDivisionError' in said)
    # What was wrong can be put right without a new process.
    node.set_parameters([Parameter('fail_at', value='')])
    assert node.trigger_configure() == SUCCESS


def test_a_failed_activation_leaves_it_inactive_and_silent(make):
    node, executor = make(fail_at='activate')
    node.trigger_configure()
    assert node.trigger_activate() == FAILURE
    assert state(node) == State.PRIMARY_STATE_INACTIVE
    assert not node.active
    assert not spin(executor, lambda: node.heard, times=20)


@pytest.mark.parametrize(
    ('name', 'value', 'complaint'),
    [('autonomy', '.nan', 'finite'), ('flavour', 'salty', 'sweet, sour'),
     ('numbers', '[1.0, .inf]', 'finite')],
)  # fmt: skip
def test_unusable_values_are_named(make, name, value, complaint, capfd):
    node, _ = make(**{name: value})
    assert node.trigger_configure() == FAILURE
    said = capfd.readouterr().err
    assert f'parameter {name}' in said
    assert complaint in said


def test_it_works_only_while_active_and_survives_bad_messages(make, capfd):
    node, executor = make()
    node.trigger_configure()
    assert not spin(executor, lambda: node.heard, times=20)
    node.trigger_activate()
    assert spin(executor, lambda: len(node.heard) > 3)
    for _ in range(5):
        node.publisher.publish(Float64(data=-1.0))
        spin(executor, lambda: False, times=3)
    said = capfd.readouterr().err
    assert said.count('out: message ignored: data: is negative') == 1
    node.publisher.publish(Float64(data=math.pi))
    assert spin(executor, lambda: math.pi in node.heard)
    node.trigger_deactivate()
    count = len(node.heard)
    spin(executor, lambda: False, times=20)
    assert len(node.heard) == count


def test_services_answer_what_is_wrong(make):
    node, executor = make()
    node.trigger_configure()
    client = node.create_client(Trigger, 'plain/go')
    assert spin(executor, client.service_is_ready)
    for active, message in ((False, 'plain is not active'), (True, 'go: not now')):
        if active:
            node.trigger_activate()
        future = client.call_async(Trigger.Request())
        assert spin(executor, future.done)
        assert not future.result().success
        assert future.result().message == message
