"""Bags in every state: whole, cut, damaged, by other recorders."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.writer import CompressionType, Writer
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from ft_manip_ros.bags.definitions import message_definition
from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.bags.writer import BagWriter
from ft_manip_ros.bags.writer_settings import WriterSettings
from ft_manip_ros.core.errors import InputError
from support.cdr import cdr

START = 1_700_000_000_000_000_000
STRING = 'std_msgs/msg/String'


def write_bag(folder: Path, count: int = 200, chunk_size: int = 1000) -> Path:
    with BagWriter(folder, WriterSettings(chunk_size=chunk_size)) as writer:
        key = writer.add_topic('/text', message_definition(STRING))
        for i in range(count):
            writer.write(key, cdr(String(data=f'message {i}')), START + i)
    return folder


def texts(path: Path) -> list[str]:
    bag = open_bag(path)
    return [bag.decode(message).data for message in bag.messages()]


EXPECTED = [f'message {i}' for i in range(200)]


@pytest.mark.parametrize('keep', [0.2, 0.5, 0.9, 0.999])
def test_a_truncated_file_gives_its_beginning_and_says_so(tmp_path: Path, keep: float) -> None:
    file = write_bag(tmp_path / 'bag') / 'bag_0.mcap'
    whole = file.read_bytes()
    file.write_bytes(whole[: int(len(whole) * keep)])
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    bag = open_bag(tmp_path / 'bag')
    got = [bag.decode(m).data for m in bag.messages()]
    assert got == EXPECTED[: len(got)]
    assert len(got) > 150 * (keep - 0.15)
    assert any('metadata.yaml is missing' in note for note in bag.notes)
    assert any('bag_0.mcap: byte' in note for note in bag.notes)
    assert not bag.sources[0].finished


@pytest.mark.parametrize('begun', [b'', b'\x89MCAP'])
def test_a_file_that_was_only_begun_costs_nothing_else(tmp_path: Path, begun: bytes) -> None:
    (write_bag(tmp_path / 'bag') / 'bag_1.mcap').write_bytes(begun)
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    assert texts(tmp_path / 'bag') == EXPECTED
    notes = open_bag(tmp_path / 'bag').notes
    assert any('bag_1.mcap' in note and 'nothing was written' in note for note in notes)


def test_a_damaged_chunk_costs_only_itself(tmp_path: Path) -> None:
    file = write_bag(tmp_path / 'bag') / 'bag_0.mcap'
    data = bytearray(file.read_bytes())
    second_chunk = data.index(b'zstd', data.index(b'zstd') + 4)
    data[second_chunk + 40 : second_chunk + 60] = b'\xff' * 20
    file.write_bytes(data)
    bag = open_bag(tmp_path / 'bag')
    got = [bag.decode(m).data for m in bag.messages()]
    assert 120 < len(got) < 200
    assert got[0] == 'message 0'
    assert got[-1] == 'message 199'
    assert set(got) < set(EXPECTED)
    assert bag.message_count == len(got)
    assert len(bag.notes) >= 1


def test_a_damaged_record_length_is_got_over(tmp_path: Path) -> None:
    file = write_bag(tmp_path / 'bag') / 'bag_0.mcap'
    data = bytearray(file.read_bytes())
    second_chunk = data.index(b'\x06', data.index(b'zstd') + 300)
    while data[second_chunk + 5 : second_chunk + 9] != b'\0\0\0\0':
        second_chunk = data.index(b'\x06', second_chunk + 1)
    data[second_chunk + 1 : second_chunk + 9] = b'\xff' * 8
    file.write_bytes(data)
    got = texts(tmp_path / 'bag')
    assert len(got) > 100
    assert got[-1] == 'message 199'


@pytest.mark.parametrize('compression', list(CompressionType))
@pytest.mark.parametrize('chunked', [True, False])
def test_single_files_by_the_mcap_library(
    tmp_path: Path, compression: CompressionType, chunked: bool
) -> None:
    path = tmp_path / 'other.mcap'
    writer = Writer(str(path), compression=compression, use_chunking=chunked, chunk_size=500)
    writer.start(profile='ros2')
    definition = message_definition(STRING)
    schema = writer.register_schema(STRING, 'ros2msg', definition.text.encode())
    channel = writer.register_channel('/text', 'cdr', schema)
    # Out of order, as a recorder with several threads writes.
    for i in [*range(100, 200), *range(100)]:
        writer.add_message(channel, START + i, cdr(String(data=f'message {i}')), START + i)
    writer.finish()
    bag = open_bag(path)
    assert bag.notes == []
    assert [bag.decode(m).data for m in bag.messages()] == EXPECTED
    assert (bag.start, bag.end) == (START, START + 199)


@pytest.mark.parametrize('plugin', list(StoragePlugin))
@pytest.mark.parametrize('with_metadata', [True, False])
def test_bags_by_rosbags_in_both_storages(
    tmp_path: Path, plugin: StoragePlugin, with_metadata: bool
) -> None:
    qos = Qos(
        QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL,
        QosTime(0, 0), QosTime(0, 0), QosLiveliness.AUTOMATIC, QosTime(0, 0), False,
    )  # fmt: skip
    definition = message_definition(STRING)
    with RosbagsWriter(tmp_path / 'bag', version=9, storage_plugin=plugin) as writer:
        writer.set_custom_data('ft_manip_ros:seed', '7')
        connection = writer.add_connection(
            '/text', STRING, msgdef=definition.text, rihs01=definition.type_hash,
            offered_qos_profiles=[qos],
        )  # fmt: skip
        for i in range(200):
            writer.write(connection, START + i, cdr(String(data=f'message {i}')))
    if not with_metadata:
        (tmp_path / 'bag' / 'metadata.yaml').unlink()
    bag = open_bag(tmp_path / 'bag')
    assert [bag.decode(m).data for m in bag.messages()] == EXPECTED
    assert bag.topics['/text'].count == 200
    if plugin is StoragePlugin.SQLITE3:
        assert bag.topics['/text'].type_hash == definition.type_hash
    assert bag.topics['/text'].qos[0].durability == 'transient_local'
    assert (bag.start, bag.end) == (START, START + 199)
    if with_metadata:
        assert bag.provenance['ft_manip_ros']['seed'] == '7'


@pytest.mark.parametrize(
    ('make', 'problem'),
    [
        (lambda path: None, 'does not exist'),
        (lambda path: path.mkdir(), r'no \.mcap or \.db3'),
        (lambda path: path.with_suffix('.txt').write_text('x'), 'does not exist'),
    ],
)
def test_missing_bags_are_named(tmp_path: Path, make: object, problem: str) -> None:
    path = tmp_path / 'bag'
    make(path)
    with pytest.raises(InputError, match=problem) as caught:
        open_bag(path)
    assert str(path) in str(caught.value)


def test_a_folder_around_one_bag_is_as_good_as_the_bag(tmp_path: Path) -> None:
    write_bag(tmp_path / 'case' / 'bag')
    (tmp_path / 'case' / 'plots').mkdir()
    assert open_bag(tmp_path / 'case').path == tmp_path / 'case' / 'bag'
    assert texts(tmp_path / 'case') == EXPECTED


def test_of_several_bags_in_a_folder_none_is_chosen(tmp_path: Path) -> None:
    for name in ('first', 'second'):
        write_bag(tmp_path / 'runs' / name)
    with pytest.raises(InputError, match='there are bags in it: first, second'):
        open_bag(tmp_path / 'runs')


@pytest.mark.parametrize(
    ('name', 'content', 'problem'),
    [
        ('x.mcap', b'\x89MCAP1', 'no MCAP file'),
        ('x.mcap', b'SQLite format 3\0', 'no MCAP file'),
        ('x.db3', b'\x89MCAP0\r\n' * 100, 'no rosbag2 database'),
        ('x.bag', b'#ROSBAG V2.0\n', r'neither \.mcap nor \.db3'),
    ],
)
def test_files_that_are_no_bags(tmp_path: Path, name: str, content: bytes, problem: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=problem):
        open_bag(tmp_path / name)


def test_an_empty_bag_is_a_bag(tmp_path: Path) -> None:
    BagWriter(tmp_path / 'bag').close()
    bag = open_bag(tmp_path / 'bag')
    assert (bag.message_count, bag.start, bag.end, bag.notes) == (0, 0, 0, [])
    assert list(bag.messages()) == []


@pytest.mark.parametrize(
    'data',
    [
        b'',
        b'\x00\x01\x00\x00',
        b'\x00\x01\x00\x00\xff\xff\xff\x7f',
        b'\x00\x01\x00\x00\x05\x00\x00\x00\xff\xfe\xfd\xfc\x00',
        b'\x01\x02\x00\x00\x01\x00\x00\x00\x00',
    ],
)
def test_wrong_cdr_names_topic_and_time(tmp_path: Path, data: bytes) -> None:
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write(writer.add_topic('/text', message_definition(STRING)), data, START)
    bag = open_bag(tmp_path / 'bag')
    with pytest.raises(InputError, match=f'/text at {START} ns'):
        bag.decode(next(bag.messages()))


def test_wrong_sequence_length_needs_no_memory(tmp_path: Path) -> None:
    message = JointState(name=['a'], position=[1.0])
    data = bytearray(cdr(message))
    at = data.index(b'\x02\x00\x00\x00a\x00') - 4
    data[at : at + 4] = b'\xff\xff\xff\xff'
    with BagWriter(tmp_path / 'bag') as writer:
        definition = message_definition('sensor_msgs/msg/JointState')
        writer.write(writer.add_topic('/joint_states', definition), bytes(data), START)
    bag = open_bag(tmp_path / 'bag')
    with pytest.raises(InputError, match='do not fit'):
        bag.decode(next(bag.messages()))


@pytest.mark.parametrize(
    'text', ['rosbag2_bagfile_information: [', 'x: 1', '', 'rosbag2_bagfile_information: {a: 1}']
)
def test_unreadable_metadata_is_noted_and_the_files_are_read(tmp_path: Path, text: str) -> None:
    folder = write_bag(tmp_path / 'bag')
    (folder / 'metadata.yaml').write_text(text)
    bag = open_bag(folder)
    assert bag.message_count == 200
    assert 'metadata.yaml' in bag.notes[0]


def test_files_that_metadata_names_and_are_gone(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / 'bag')
    text = (folder / 'metadata.yaml').read_text()
    (folder / 'metadata.yaml').write_text(text.replace('- bag_0.mcap', '- bag_0.mcap\n  - b.mcap'))
    bag = open_bag(folder)
    assert bag.message_count == 200
    assert 'missing: b.mcap' in bag.notes[0]
