"""What the writer writes, as independent readers see it."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rclpy.serialization import deserialize_message
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from ft_manip_ros.bags.definitions import message_definition
from ft_manip_ros.bags.mcap_file import McapFile, WholeRecordFile
from ft_manip_ros.bags.qos import LATCHED, SENSOR_DATA
from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.bags.writer import BagWriter
from ft_manip_ros.bags.writer_settings import WriterSettings
from ft_manip_ros.core.errors import InputError
from support.cdr import cdr

START = 1_700_000_000_000_000_000
STEP = 10_000_000


def joint_state(i: int) -> JointState:
    message = JointState()
    message.header.stamp.sec = i
    message.name = ['joint_2', 'joint_1']
    message.position = [0.1 * i, -0.25]
    message.velocity = [float(i)]
    return message


def write_bag(folder: Path, count: int = 300, **settings: object) -> Path:
    with BagWriter(folder, WriterSettings(**settings)) as writer:
        writer.add_provenance('ft_manip_ros', {'seed': '7', 'arm': 'paredis_table_3'})
        writer.add_attachment('arm.yaml', 'application/yaml', b'name: arm\n')
        text = writer.add_topic('/note', message_definition('std_msgs/msg/String'), (LATCHED,))
        state = writer.add_topic(
            '/joint_states', message_definition('sensor_msgs/msg/JointState'), (SENSOR_DATA,)
        )
        writer.write(text, cdr(String(data='début')), START, START - 5)
        for i in range(count):
            writer.write(state, cdr(joint_state(i)), START + i * STEP)
    return folder


@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'none'])
def test_rosbags_reads_every_message_back(tmp_path: Path, compression: str) -> None:
    folder = write_bag(tmp_path / 'bag', compression=compression, chunk_size=4000)
    with AnyReader([folder], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        seen = [(c.topic, t, reader.deserialize(d, c.msgtype)) for c, t, d in reader.messages()]
        qos = reader.topics['/note'].connections[0].ext.offered_qos_profiles
    assert seen[0][0] == '/joint_states' or seen[0][2].data == 'début'
    states = [entry for entry in seen if entry[0] == '/joint_states']
    assert len(states) == 300
    for i, (_, log_time, message) in enumerate(states):
        assert log_time == START + i * STEP
        assert message.name == ['joint_2', 'joint_1']
        assert message.position.tolist() == [0.1 * i, -0.25]
        assert message.velocity.tolist() == [float(i)]
    assert (qos[0].durability.name, qos[0].depth) == ('TRANSIENT_LOCAL', 1)


def test_mcap_reads_every_message_back(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / 'bag', chunk_size=4000)
    with (folder / 'bag_0.mcap').open('rb') as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == 'ros2'
        statistics = reader.get_summary().statistics
        channels = {c.topic: c for c in reader.get_summary().channels.values()}
        decoded = list(reader.iter_decoded_messages(topics=['/joint_states']))
        raw = [m.data for _, _, m in reader.iter_messages(topics=['/joint_states'])]
        attachments = {a.name: a.data for a in reader.iter_attachments()}
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
    assert statistics.message_count == 301
    assert statistics.chunk_count > 5
    assert [d.decoded_message.position for d in decoded] == [[0.1 * i, -0.25] for i in range(300)]
    assert [deserialize_message(data, JointState) for data in raw] == [
        joint_state(i) for i in range(300)
    ]
    state = channels['/joint_states']
    assert state.message_encoding == 'cdr'
    assert state.metadata['topic_type_hash'] == get_typestore(Stores.ROS2_JAZZY).hash_rihs01(
        'sensor_msgs/msg/JointState'
    )
    assert yaml.safe_load(state.metadata['offered_qos_profiles'])[0]['reliability'] == (
        'best_effort'
    )
    assert attachments == {'arm.yaml': b'name: arm\n'}
    assert metadata['ft_manip_ros'] == {'seed': '7', 'arm': 'paredis_table_3'}
    assert 'rosbag2' in metadata


def test_metadata_yaml_is_version_9_and_complete(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / 'bag')
    info = yaml.safe_load((folder / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    assert info['version'] == 9
    assert info['storage_identifier'] == 'mcap'
    assert info['message_count'] == 301
    assert info['starting_time']['nanoseconds_since_epoch'] == START
    assert info['duration']['nanoseconds'] == 299 * STEP
    assert info['relative_file_paths'] == ['bag_0.mcap']
    counts = {
        t['topic_metadata']['name']: t['message_count'] for t in info['topics_with_message_count']
    }
    assert counts == {'/note': 1, '/joint_states': 300}
    assert info['custom_data']['ft_manip_ros:seed'] == '7'


def test_own_reader_agrees(tmp_path: Path) -> None:
    bag = open_bag(write_bag(tmp_path / 'bag', chunk_size=4000))
    assert bag.notes == []
    assert bag.message_count == 301
    assert bag.provenance['ft_manip_ros']['seed'] == '7'
    states = list(bag.messages(['/joint_states']))
    assert [m.log_time for m in states] == [START + i * STEP for i in range(300)]
    assert bag.decode(states[7]).position.tolist() == [0.1 * 7, -0.25]
    note = next(bag.messages(['/note']))
    assert (note.log_time, note.publish_time) == (START, START - 5)
    window = list(bag.messages(['/joint_states'], start=START + 5 * STEP, end=START + 8 * STEP))
    assert len(window) == 4


def test_splits_by_size_and_by_time_lose_nothing(tmp_path: Path) -> None:
    by_size = open_bag(
        write_bag(tmp_path / 'size', split_size=8000, compression='none', chunk_size=1000)
    )
    by_time = open_bag(write_bag(tmp_path / 'time', split_duration=1.0))
    for bag in (by_size, by_time):
        assert len(bag.sources) >= 3
        assert bag.message_count == 301
        positions = [bag.decode(m).position[0] for m in bag.messages(['/joint_states'])]
        assert positions == [0.1 * i for i in range(300)]
        for source in bag.sources:
            assert source.finished
            assert source.attachments['arm.yaml'][1] == b'name: arm\n'
    # Every file spans at most a second.
    assert all(source.end - source.start <= 1_000_000_000 for source in by_time.sources)


def test_an_existing_folder_is_never_touched(tmp_path: Path) -> None:
    folder = write_bag(tmp_path / 'bag')
    before = {path: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(InputError, match='exists already'):
        BagWriter(folder)
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize(
    ('settings', 'field'),
    [
        ({'compression': 'zip'}, 'compression'),
        ({'flush_interval': 0.0}, 'flush_interval'),
        ({'flush_interval': float('nan')}, 'flush_interval'),
        ({'chunk_size': 0}, 'chunk_size'),
        ({'split_size': -1}, 'split_size'),
        ({'split_duration': float('nan')}, 'split_duration'),
    ],
)
def test_bad_settings_are_named(settings: dict[str, object], field: str) -> None:
    with pytest.raises(InputError, match=field):
        WriterSettings(**settings)


def test_unwritable_place_is_an_input_error(tmp_path: Path) -> None:
    blocker = tmp_path / 'file'
    blocker.write_text('')
    with pytest.raises(InputError, match='cannot be created'):
        BagWriter(blocker / 'bag')


def test_a_type_change_on_a_topic_gets_its_own_channel(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as writer:
        first = writer.add_topic('/x', message_definition('std_msgs/msg/String'))
        again = writer.add_topic('/x', message_definition('std_msgs/msg/String'))
        other = writer.add_topic('/x', message_definition('std_msgs/msg/Int32'))
        assert first == again != other
        writer.write(first, cdr(String(data='a')), START)
        writer.write(other, b'\x00\x01\x00\x00\x07\x00\x00\x00', START + 1)
    bag = open_bag(tmp_path / 'bag')
    assert [bag.decode(m).data for m in bag.messages()] == ['a', 7]


class FullDisk:
    """A file that accepts only so many bytes."""

    def __init__(self, room: int) -> None:
        self.room = room
        self.original = WholeRecordFile.write

    def write(self, file: WholeRecordFile, data: bytes) -> int:
        if len(data) > self.room:
            raise OSError(errno.ENOSPC, 'No space left on device')
        self.room -= len(data)
        return self.original(file, data)


def test_a_full_disk_raises_and_nothing_is_lost_once_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = FullDisk(20_000)
    monkeypatch.setattr(WholeRecordFile, 'write', lambda file, data: disk.write(file, data))
    writer = BagWriter(tmp_path / 'bag', WriterSettings(compression='none', chunk_size=2000))
    key = writer.add_topic('/joint_states', message_definition('sensor_msgs/msg/JointState'))
    errors = 0
    for i in range(400):
        if i == 200:
            disk.room = 10**9
        try:
            writer.write(key, cdr(joint_state(i)), START + i * STEP)
        except OSError as error:
            assert error.errno == errno.ENOSPC
            errors += 1
            if i < 200:
                break
    assert errors
    # What reached the disk is readable while the disk is still full.
    partial = open_bag(tmp_path / 'bag')
    kept = [partial.decode(m).header.stamp.sec for m in partial.messages()]
    assert kept == list(range(len(kept)))
    assert len(kept) > 10
    disk.room = 10**9
    for k in range(i + 1, 400):
        writer.write(key, cdr(joint_state(k)), START + k * STEP)
    writer.close()
    bag = open_bag(tmp_path / 'bag')
    assert [bag.decode(m).header.stamp.sec for m in bag.messages()] == list(range(400))
    with AnyReader([tmp_path / 'bag'], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        assert reader.message_count == 400


def test_a_partial_write_is_taken_back(tmp_path: Path) -> None:
    file = WholeRecordFile(tmp_path / 'file')
    file.write(b'whole')

    class HalfWriter:
        def __init__(self, raw: object) -> None:
            self.raw = raw
            self.calls = 0

        def __getattr__(self, name: str) -> object:
            return getattr(self.raw, name)

        def write(self, data: memoryview) -> int:
            self.calls += 1
            if self.calls > 1:
                raise OSError(errno.ENOSPC, 'No space left on device')
            return self.raw.write(data[:2])

    file._file = HalfWriter(file._file)
    with pytest.raises(OSError, match='No space'):
        file.write(b'partial')
    file.close()
    assert (tmp_path / 'file').read_bytes() == b'whole'


def test_a_single_mcap_file_never_overwrites(tmp_path: Path) -> None:
    (tmp_path / 'x.mcap').write_bytes(b'mine')
    with pytest.raises(FileExistsError):
        McapFile(tmp_path / 'x.mcap')
    assert (tmp_path / 'x.mcap').read_bytes() == b'mine'
