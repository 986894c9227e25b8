"""The recorder as a process: everything that was sent is in the bag, field for field."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from mcap.reader import make_reader
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Int32, String
from std_srvs.srv import Trigger

from ft_manip_interfaces.msg import FaultState, JointFault, Task, TaskGoal
from ft_manip_interfaces.srv import InjectFault
from ft_manip_ros.bags.reader import Bag, open_bag
from ft_manip_ros.nodes import topics
from support.cdr import canonical, cdr

pytestmark = pytest.mark.node

COUNT = 400


def joint_state(i: int) -> JointState:
    message = JointState(name=[f'joint_{k}' for k in range(7)], position=[float(i)] * 7)
    message.header.stamp.sec = i
    return message


def start(start_node: Callable[..., Any], folder: Path, **params: Any) -> Any:
    process = start_node('recorder', params={'output': str(folder), **params})
    process.wait_for('recording to')
    return process


def stop(process: Any, number: int = signal.SIGINT) -> Bag:
    begin = time.monotonic()
    process.stop(number)
    assert time.monotonic() - begin < 2.0
    output = Path(process.output.split('recording to ')[1].splitlines()[0])
    return open_bag(output)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_everything_sent_is_in_the_bag(
    start_node: Callable[..., Any], probe: Any, tmp_path: Path, number: int
) -> None:
    # A latched task is there before the recorder is.
    task = Task(name='eq_11', goals=[TaskGoal(id='first')])
    latched = probe.node.create_publisher(Task, topics.TASK, topics.LATCHED_QOS)
    latched.publish(task)
    states = probe.node.create_publisher(JointState, topics.JOINT_STATES, topics.SENSOR_QOS)
    recorder = start(start_node, tmp_path / 'bag')
    probe.until(states.get_subscription_count, 10.0, 'the recorder')
    # A late joiner with a type of its own.
    faults = probe.publisher(FaultState, topics.FAULT_STATE, topics.LATCHED_QOS)
    for i in range(COUNT):
        states.publish(joint_state(i))
        time.sleep(0.001)
    faults.publish(FaultState(sequence=3, frozen_joints=['joint_2'], frozen_positions=[0.5]))
    probe.spin_for(0.3)
    bag = stop(recorder, number)
    probe.node.destroy_publisher(latched)
    probe.node.destroy_publisher(states)
    probe.node.destroy_publisher(faults)

    assert 'none lost' in recorder.output
    assert bag.notes == []
    recorded = [canonical(m.type_name, m.data) for m in bag.messages(['/joint_states'])]
    assert recorded == [cdr(joint_state(i)) for i in range(COUNT)]
    assert [bag.decode(m).name for m in bag.messages(['/task'])] == ['eq_11']
    assert [bag.decode(m).frozen_joints for m in bag.messages(['/fault_state'])] == [['joint_2']]
    assert bag.topics['/joint_states'].qos[0].reliability == 'best_effort'
    assert bag.topics['/task'].qos[0].durability == 'transient_local'

    with AnyReader([bag.path], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        rosbags = [(c.topic, t, bytes(d)) for c, t, d in reader.messages()]
    with next(bag.path.glob('*.mcap')).open('rb') as file:
        mcap = [
            (c.topic, m.log_time, m.data)
            for _, c, m in make_reader(file, validate_crcs=True).iter_messages()
        ]
    own = [(m.topic, m.log_time, m.data) for m in bag.messages()]
    assert sorted(own) == sorted(rosbags) == sorted(mcap)


def test_services_parameters_and_arm_files_are_recorded(
    start_node: Callable[..., Any], probe: Any, tmp_path: Path
) -> None:
    sim = start_node('arm_sim', params={'rate': 50.0})
    sim.wait_for('active')
    recorder = start(start_node, tmp_path / 'bag', seed=11, note='a test')
    recorder.wait_for('has the parameters of /arm_sim')
    events = topics.service_events(topics.INJECT_FAULT)
    probe.until(lambda: probe.node.count_subscribers(events), 20.0, 'the recorder')
    request = InjectFault.Request(joint='joint_3', kind=InjectFault.Request.LOCK)
    assert probe.call(InjectFault, topics.INJECT_FAULT, request).success
    probe.spin_for(0.5)
    bag = stop(recorder)
    events = [bag.decode(m) for m in bag.messages(['/arm_sim/inject_fault/_service_event'])]
    assert [len(event.request) for event in events if event.request]
    assert {event.request[0].joint for event in events if event.request} == {'joint_3'}
    assert any(event.response and event.response[0].success for event in events)
    assert bag.provenance['ft_manip_ros']['seed'] == '11'
    assert bag.provenance['ft_manip_ros']['note'] == 'a test'
    assert bag.provenance['parameters/arm_sim']['rate'] == '50.0'
    assert bag.provenance['parameters/arm_sim']['arm'] == 'paredis_table_3'
    assert b'paredis_table_3' in bag.attachments['arm/arm_sim.yaml'][1]
    assert bag.topics['/joint_states'].count > 5


def test_qos_follows_publishers_that_join_later(
    start_node: Callable[..., Any], probe: Any, tmp_path: Path
) -> None:
    recorder = start(start_node, tmp_path / 'bag', topics=['chatter'])
    reliable = probe.publisher(String, 'chatter', QoSProfile(depth=10))
    reliable.publish(String(data='reliable'))
    probe.spin_for(0.3)
    weak = probe.node.create_publisher(String, 'chatter', qos_profile_sensor_data)
    probe.until(weak.get_subscription_count, 10.0, 'the recorder to ask for less')
    weak.publish(String(data='best effort'))
    probe.spin_for(0.3)
    bag = stop(recorder)
    probe.node.destroy_publisher(reliable)
    probe.node.destroy_publisher(weak)
    got = [bag.decode(m).data for m in bag.messages(['/chatter'])]
    assert got == ['reliable', 'best effort']


def test_a_topic_that_changes_its_type(
    start_node: Callable[..., Any], probe: Any, tmp_path: Path
) -> None:
    recorder = start(start_node, tmp_path / 'bag', topics=['chatter'])
    text = probe.publisher(String, 'chatter')
    text.publish(String(data='text'))
    probe.spin_for(0.3)
    probe.node.destroy_publisher(text)
    probe.spin_for(0.5)
    number = probe.publisher(Int32, 'chatter')
    number.publish(Int32(data=5))
    probe.spin_for(0.3)
    bag = stop(recorder)
    probe.node.destroy_publisher(number)
    assert [bag.decode(m).data for m in bag.messages(['/chatter'])] == ['text', 5]


def test_an_existing_bag_is_refused_and_the_node_lives(
    start_node: Callable[..., Any], tmp_path: Path
) -> None:
    (tmp_path / 'bag').mkdir()
    recorder = start_node('recorder', params={'output': str(tmp_path / 'bag')})
    recorder.wait_for('exists already')
    time.sleep(0.5)
    assert recorder.running
    assert recorder.stop() == 0
    assert list((tmp_path / 'bag').iterdir()) == []


def test_a_killed_recorder_leaves_a_bag_and_the_next_one_says_so(
    start_node: Callable[..., Any], probe: Any, tmp_path: Path
) -> None:
    recorder = start(start_node, tmp_path / 'killed', flush_interval=0.1)
    states = probe.publisher(JointState, topics.JOINT_STATES, topics.SENSOR_QOS)
    for i in range(COUNT):
        states.publish(joint_state(i))
        time.sleep(0.002)
    time.sleep(0.5)
    for i in range(COUNT, COUNT + 20):
        states.publish(joint_state(i))
    recorder.stop(signal.SIGKILL)
    probe.node.destroy_publisher(states)
    bag = open_bag(tmp_path / 'killed')
    got = [bag.decode(m).header.stamp.sec for m in bag.messages(['/joint_states'])]
    assert got[:COUNT] == list(range(COUNT))
    assert any('metadata.yaml is missing' in note for note in bag.notes)
    again = start(start_node, tmp_path / 'next')
    again.wait_for(f'{tmp_path / "killed"} was not closed')


def test_a_full_disk_is_an_error_in_diagnostics(
    start_node: Callable[..., Any], probe: Any, tmp_path: Path, start_process: Callable[..., Any]
) -> None:
    """The file size limit of a shell stands for the full disk: the kernel refuses to write."""
    diagnostics = probe.listen(DiagnosticArray, topics.DIAGNOSTICS)
    command = (
        'trap "" XFSZ; ulimit -f 40; exec ros2 run ft_manip_ros recorder --ros-args '
        f'-p output:={tmp_path / "bag"} -p compression:=none -p flush_interval:=0.1'
    )
    recorder = start_process('bash', '-c', command)
    recorder.wait_for('recording to')
    states = probe.publisher(JointState, topics.JOINT_STATES, topics.SENSOR_QOS)

    def refused() -> bool:
        states.publish(joint_state(0))
        return any(
            status.level == b'\x02' and 'File too large' in status.message
            for message in diagnostics
            for status in message.status
        )

    probe.until(refused, 20.0, 'an error in diagnostics')
    assert recorder.running
    probe.node.destroy_publisher(states)
    bag = open_bag(tmp_path / 'bag')
    assert bag.topics['/joint_states'].count > 20
    for message in bag.messages():
        bag.decode(message)
    recorder.stop()


def test_snapshot_mode_keeps_only_what_surrounds_a_fault(
    start_node: Callable[..., Any], probe: Any, tmp_path: Path
) -> None:
    recorder = start(
        start_node, tmp_path / 'out', mode='snapshot', snapshot_before=0.5, snapshot_after=0.3
    )
    states = probe.publisher(JointState, topics.JOINT_STATES, topics.SENSOR_QOS)
    faults = probe.publisher(JointFault, topics.FAULT_EVENTS, topics.EVENT_QOS)

    def publish(first: int, count: int) -> None:
        for i in range(first, first + count):
            states.publish(joint_state(i))
            time.sleep(0.01)

    publish(0, 200)
    faults.publish(JointFault(name='joint_1', state=JointFault.SUSPECT))
    publish(200, 100)
    faults.publish(JointFault(name='joint_1', state=JointFault.LOCKED))
    publish(300, 100)
    recorder.wait_for('snapshot: ')
    assert probe.call(Trigger, 'recorder/save_snapshot', Trigger.Request()).success
    recorder.stop()
    probe.node.destroy_publisher(states)
    probe.node.destroy_publisher(faults)
    first, second = (open_bag(path) for path in sorted((tmp_path / 'out').iterdir()))
    numbers = [first.decode(m).header.stamp.sec for m in first.messages(['/joint_states'])]
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    # Under load a message may take its time, but the seconds before and after are not kept.
    assert 200 < numbers[0] < 299 < numbers[-1] < 399
    assert first.topics['/fault_events'].count == 1
    assert second.message_count > 0


def test_simulated_time_stamps_the_messages(
    start_node: Callable[..., Any], probe: Any, tmp_path: Path
) -> None:
    recorder = start(start_node, tmp_path / 'bag', use_sim_time=True)
    clock = probe.publisher(Clock, '/clock')
    states = probe.publisher(JointState, topics.JOINT_STATES, topics.SENSOR_QOS)
    for second in (100, 101):
        clock.publish(Clock(clock=Time(sec=second)))
        probe.spin_for(0.3)
        states.publish(joint_state(second))
        probe.spin_for(0.3)
    bag = stop(recorder)
    for publisher in (clock, states):
        probe.node.destroy_publisher(publisher)
    assert [m.log_time for m in bag.messages(['/joint_states'])] == [100 * 10**9, 101 * 10**9]
