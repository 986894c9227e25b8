"""Replay finds what is there, misses nothing that was changed, and is the same everywhere."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter

from ft_manip_ros.bags.definitions import message_definition
from ft_manip_ros.bags.findings import Finding, Tolerance, compare, digest
from ft_manip_ros.bags.reader import Bag, BagMessage, open_bag
from ft_manip_ros.bags.replay import ReplayResult, replay
from ft_manip_ros.bags.writer import BagWriter
from ft_manip_ros.cli.main import main
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.nodes.conversions import nanoseconds
from support.bag_rewrite import definitions, rewrite

CASE = Path(__file__).resolve().parents[2] / 'bags' / 'locked_joint'


def test_the_case_holds_all_three_kinds(result: ReplayResult) -> None:
    assert {finding.kind for finding in result.replayed} == {'verdict', 'fault', 'plan'}
    assert result.differences == ()
    assert result.recorded and len(result.recorded) == len(result.replayed)
    assert not result.refused


@pytest.mark.parametrize('name', ['lossy_transport', 'stale_joint', 'bad_sensor', 'two_failures'])
def test_blocks_of_joint_states_come_to_what_single_ones_do(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = open_bag(CASE.parent / name / 'bag')
    in_blocks = replay(bag)
    monkeypatch.setattr('ft_manip_ros.bags.replay._in_blocks', lambda bag, parts: set())
    one_by_one = replay(bag)
    assert in_blocks.replayed == one_by_one.replayed
    assert in_blocks.refused == one_by_one.refused
    assert in_blocks.messages == one_by_one.messages


def test_exact_compares_what_conclusions_rest_on(bag: Bag, tmp_path: Path) -> None:
    """A plan that takes another second comes to the same conclusion, but is not the same."""
    from support.cdr import edited

    kinds = definitions(bag)

    def later(message: Any) -> None:
        message.trajectory.points[-1].time_from_start.sec += 1

    def slower(record: BagMessage) -> BagMessage:
        if record.topic != '/recovery_plan':
            return record
        text = kinds[record.type_name].text
        return record._replace(data=edited(record.type_name, text, record.data, later))

    changed = rewrite(bag, tmp_path / 'bag', slower)
    assert replay(changed).differences == ()
    different = [d for d in replay(changed, exact=True).differences if 'duration' in d.fields]
    assert [d.recorded.kind for d in different if d.recorded] == ['plan']


def test_the_digest_does_not_depend_on_threads(bag: Bag, result: ReplayResult) -> None:
    assert replay(bag, threads=3).digest == result.digest


@pytest.mark.parametrize('plugin', list(StoragePlugin))
def test_a_bag_by_another_recorder_has_the_same_digest(
    bag: Bag, result: ReplayResult, tmp_path: Path, plugin: StoragePlugin
) -> None:
    """Another writer, another order of topics and of messages, other chunks."""
    with RosbagsWriter(tmp_path / 'other', version=9, storage_plugin=plugin) as writer:
        for name, values in bag.provenance.items():
            for key, value in values.items():
                writer.set_custom_data(f'{name}:{key}', value)
        connections, kinds = {}, definitions(bag)
        for topic in sorted(bag.topics, reverse=True):
            type_name = bag.topics[topic].type_name
            definition = kinds[type_name]
            connections[topic] = writer.add_connection(
                topic, type_name, msgdef=definition.text, rihs01=definition.type_hash or 'RIHS01_0'
            )
        for message in sorted(bag.messages(), key=lambda m: (m.log_time // 10**9, m.topic)):
            writer.write(connections[message.topic], message.log_time, message.data)
    other = replay(open_bag(tmp_path / 'other'))
    assert other.digest == result.digest
    assert other.differences == ()


def test_a_topic_that_changed_its_type_loses_the_other_ones_alone(
    bag: Bag, result: ReplayResult, tmp_path: Path
) -> None:
    """Among the joint states are texts, some of them in a row and as long as a joint state."""
    from std_msgs.msg import String

    from support.cdr import cdr

    name = 'std_msgs/msg/String'
    size = len(next(bag.messages(['/joint_states'])).data)
    empty = len(cdr(String()))
    step = (bag.end - bag.start) // 60
    extra = [
        BagMessage('/joint_states', name, at, at, cdr(String(data='x' * (size - empty))))
        for at in (
            *range(bag.start + step, bag.end, step),
            *range(bag.start + 10**9, bag.start + 10**9 + 40),
        )
    ]
    changed = rewrite(bag, tmp_path / 'bag', None, extra)
    again = replay(changed)
    (reason,) = again.refused
    assert 'is std_msgs/msg/String, on a topic of sensor_msgs/msg/JointState' in reason
    assert again.refused[reason] == len(extra)
    assert again.digest == result.digest
    for command in ('report', 'detect', 'replay'):
        output = ['--output', str(tmp_path / 'report')] if command == 'report' else []
        assert main([command, str(tmp_path / 'bag'), *output]) == 0


def test_a_fault_that_was_not_recorded_is_a_difference(bag: Bag, tmp_path: Path) -> None:
    edited = rewrite(bag, tmp_path / 'bag', lambda m: None if m.topic == '/fault_events' else m)
    differences = replay(edited).differences
    assert [d.recorded for d in differences] == [None]
    assert differences[0].replayed is not None
    assert differences[0].replayed.about == 'joint_3'
    assert main(['replay', str(tmp_path / 'bag'), '--check']) == 1
    assert main(['replay', str(tmp_path / 'bag')]) == 0


def test_a_changed_input_is_a_difference(bag: Bag, tmp_path: Path) -> None:
    """The same arm, but the locked joint moves on in the joint states: no lock is found."""
    from rclpy.serialization import deserialize_message
    from sensor_msgs.msg import JointState
    from trajectory_msgs.msg import JointTrajectory

    from ft_manip_ros.nodes.conversions import path_from_message
    from support.cdr import cdr

    topic = '/joint_trajectory_controller/joint_trajectory'
    command = deserialize_message(next(bag.messages([topic])).data, JointTrajectory)
    path = path_from_message(command, [f'joint_{i}' for i in range(1, 6)])
    start = nanoseconds(command.header.stamp)
    locked = next(f for f in replay(bag).replayed if f.kind == 'fault').stamp

    def move_on(record: BagMessage) -> BagMessage | None:
        if record.topic != '/joint_states':
            # The recorded new plan would hold the joint.
            holding = record.topic in (topic, '/recovery_plan') and record.log_time > locked
            return None if holding else record
        message = deserialize_message(record.data, JointState)
        stamp = nanoseconds(message.header.stamp)
        if stamp < locked - 300_000_000:
            return record
        k = list(message.name).index('joint_3')
        position, velocity = path.sample((stamp - start) * 1e-9 - 0.033)[:2]
        message.position[k], message.velocity[k] = position[2], velocity[2]
        return record._replace(data=cdr(message))

    differences = replay(rewrite(bag, tmp_path / 'bag', move_on)).differences
    missing = [d.recorded for d in differences if d.replayed is None]
    assert any(f is not None and f.kind == 'fault' and f.about == 'joint_3' for f in missing)


def test_an_override_says_by_how_much(
    bag: Bag, result: ReplayResult, capsys: pytest.CaptureFixture[str]
) -> None:
    """A less sensitive monitor, and one that has to be sure for longer, find the fault later."""

    def found(**overrides: float) -> int:
        replayed = replay(bag, overrides=overrides).replayed
        return next(finding.stamp for finding in replayed if finding.kind == 'fault')

    recorded = next(finding.stamp for finding in result.recorded if finding.kind == 'fault')
    assert found(sensitivity=5.0) > recorded
    assert found(**{'fault_monitor.confirm_s': 0.5}) > recorded + 400_000_000
    assert main(['replay', str(CASE / 'bag'), '--override', 'fault_monitor.sensitivity=5']) == 0
    assert re.search(r'\(\+[0-9.]+ ms\)', capsys.readouterr().out)


@pytest.mark.parametrize(
    ('arguments', 'problem'),
    [
        (['--override', 'sensitivty=1'], 'is no parameter of the replay'),
        (['--override', 'sensitivity'], 'PARAM=VALUE'),
        (['--override', 'sensitivity=-1'], 'sensitivity'),
        (['--override', 'policy=fly'], 'policy'),
        (['--from', '-1'], '--from'),
        (['--from', '3', '--to', '2'], '--from'),
        (['--arm', 'no_such_arm'], 'no_such_arm'),
        (['--expected', 'no_such_file.yaml'], 'no_such_file.yaml'),
    ],
)
def test_bad_arguments_are_named(
    arguments: list[str], problem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['replay', str(CASE / 'bag'), *arguments]) == 2
    assert problem in capsys.readouterr().err


def test_a_missing_bag_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['replay', str(tmp_path / 'none')]) == 2
    assert 'does not exist' in capsys.readouterr().err


def test_malformed_messages_are_refused_and_the_rest_is_replayed(
    bag: Bag, result: ReplayResult, tmp_path: Path
) -> None:
    first = next(bag.messages(['/joint_states'])).log_time

    def spoil(message: BagMessage) -> BagMessage:
        if message.topic == '/joint_states' and message.log_time == first:
            return message._replace(data=message.data[:40])
        return message

    spoiled = replay(rewrite(bag, tmp_path / 'bag', spoil))
    assert sum(spoiled.refused.values()) == 1
    assert '/joint_states' in next(iter(spoiled.refused))
    assert spoiled.differences == ()


def test_a_bag_without_parameters_uses_defaults_and_says_so(bag: Bag, tmp_path: Path) -> None:
    kinds = definitions(bag)
    with BagWriter(tmp_path / 'bare') as writer:
        for message in bag.messages():
            key = writer.add_topic(message.topic, kinds[message.type_name])
            writer.write(key, message.data, message.log_time)
    with pytest.raises(InputError, match='--arm'):
        replay(open_bag(tmp_path / 'bare'))
    bare = replay(open_bag(tmp_path / 'bare'), arm='paredis_table_3')
    assert any('no parameters of fault_monitor' in note for note in bare.notes)
    assert bare.differences == ()


def test_a_bag_with_nothing_to_replay(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as writer:
        key = writer.add_topic('/x', message_definition('std_msgs/msg/Int32'))
        writer.write(key, b'\x00\x01\x00\x00\x01\x00\x00\x00', 1)
    with pytest.raises(InputError, match='nothing to replay'):
        replay(open_bag(tmp_path / 'bag'), arm='paredis_table_3')


def test_expected_is_compared_and_can_fail(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(CASE, tmp_path / 'case')
    file = tmp_path / 'case' / 'expected.yaml'
    content = yaml.safe_load(file.read_text())
    fault = next(entry for entry in content['findings'] if entry['kind'] == 'fault')
    fault['position'] += 0.02
    file.write_text(yaml.safe_dump(content))
    assert main(['replay', str(tmp_path / 'case' / 'bag'), '--check']) == 1
    assert 'not as expected: fault joint_3' in capsys.readouterr().out
    content['findings'].remove(fault)
    file.write_text(yaml.safe_dump(content))
    assert main(['replay', str(tmp_path / 'case' / 'bag'), '--check']) == 1
    assert 'was not expected' in capsys.readouterr().out


def test_json_is_one_object(capsys: pytest.CaptureFixture[str], result: ReplayResult) -> None:
    assert main(['replay', str(CASE / 'bag'), '--json']) == 0
    content: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert content['digest'] == result.digest
    assert content['differences'] == []
    assert len(content['replayed']) == len(result.replayed)


def fault(stamp: int, to: str = 'LOCKED', position: float = 0.5) -> Finding:
    return Finding('fault', stamp, 'joint_1', {'to': to, 'position': position})


def test_comparison_pairs_in_time_and_names_the_fields() -> None:
    tolerance = Tolerance(time=0.01, pairing=0.1, numbers={'position': 1e-3})
    assert compare([fault(0)], [fault(9_000_000, position=0.5009)], tolerance) == []
    (difference,) = compare([fault(0)], [fault(20_000_000, position=0.502)], tolerance)
    assert difference.fields == ('time', 'position')
    assert len(compare([fault(0)], [fault(200_000_000)], tolerance)) == 2
    both = compare([fault(0), fault(50_000_000, 'OK')], [fault(50_000_000, 'OK')], tolerance)
    assert [d.recorded for d in both] == [fault(0)]
    assert (
        compare([fault(0, position=float('nan'))], [fault(0, position=float('nan'))], tolerance)
        == []
    )


def test_digest_ignores_order_and_rounding_but_no_content() -> None:
    a, b = fault(1), fault(2, 'OK')
    assert digest([a, b]) == digest([b, a])
    assert digest([fault(1, position=0.5 + 1e-12)]) == digest([a])
    assert digest([fault(1, position=-1e-12)]) == digest([fault(1, position=0.0)])
    assert len({digest([a]), digest([b]), digest([a, b]), digest([fault(1, position=0.6)])}) == 4
