"""Thirty bags damaged at random: an error that names the file, or the part that is left."""

from __future__ import annotations

import resource
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from ft_manip_interfaces.msg import JointFault
from ft_manip_ros.bags.copy import copy_bag
from ft_manip_ros.bags.definitions import message_definition
from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.bags.writer import BagWriter
from ft_manip_ros.cli.main import main
from ft_manip_ros.core.errors import InputError
from support.cdr import cdr

CASE = Path(__file__).resolve().parents[2] / 'bags' / 'locked_joint' / 'bag'
WHOLE = next(CASE.glob('*.mcap')).read_bytes()
_MEMORY = 3 << 30  # bytes of address space, beyond what the libraries themselves map


def flip_bytes(data: bytearray, rng: np.random.Generator) -> bytearray:
    for at in rng.integers(8, len(data), 20):
        data[at] ^= int(rng.integers(1, 256))
    return data


def cut(data: bytearray, rng: np.random.Generator) -> bytearray:
    return data[: int(rng.integers(10, len(data)))]


def cut_out(data: bytearray, rng: np.random.Generator) -> bytearray:
    a, b = sorted(rng.integers(8, len(data), 2))
    return data[:a] + data[b:]


def swap_records(data: bytearray, rng: np.random.Generator) -> bytearray:
    places = records(data)
    (a, b), (c, d) = (places[k] for k in sorted(rng.choice(len(places), 2, replace=False)))
    return data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]


def huge_length(data: bytearray, rng: np.random.Generator) -> bytearray:
    a, _ = records(data)[int(rng.integers(len(records(data))))]
    data[a + 1 : a + 9] = struct.pack('<Q', int(rng.integers(1 << 31, 1 << 62)))
    return data


def huge_uncompressed(data: bytearray, rng: np.random.Generator) -> bytearray:
    chunks = [a for a, _ in records(data) if data[a] == 6]
    at = int(rng.choice(chunks))
    data[at + 25 : at + 33] = struct.pack('<Q', int(rng.integers(1 << 31, 1 << 62)))
    return data


def records(data: bytes) -> list[tuple[int, int]]:
    """Begin and end of the records of the whole file's data section."""
    found, at = [], 8
    while at + 9 < len(data) - 8:
        length = struct.unpack_from('<Q', data, at + 1)[0]
        found.append((at, at + 9 + length))
        at += 9 + length
    return found


DAMAGES = (flip_bytes, cut, cut_out, swap_records, huge_length, huge_uncompressed)


@pytest.mark.parametrize('seed', range(5))
@pytest.mark.parametrize('damage', DAMAGES)
def test_damage_is_named_or_survived(
    damage: object, seed: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = damage(bytearray(WHOLE), np.random.default_rng([seed, 7]))
    (tmp_path / 'damaged.mcap').write_bytes(data)
    path = tmp_path / 'damaged.mcap'
    assert main(['bag', 'info', str(path)]) in (0, 2)
    try:
        bag = open_bag(path)
    except InputError as error:
        assert 'damaged.mcap' in str(error)
        return
    original = {(m.topic, m.log_time, m.data) for m in open_bag(CASE).messages()}
    left = [(m.topic, m.log_time, m.data) for m in bag.messages()]
    # Checksums: what is given out is what was recorded.
    assert set(left) <= original
    assert len(left) == bag.message_count
    if len(left) < len(original):
        assert bag.notes
    if seed < 2:
        assert main(['replay', str(path)]) in (0, 2)
    assert main(['bag', 'recover', str(path), str(tmp_path / 'out')]) in (0, 1)
    again = open_bag(tmp_path / 'out')
    assert again.notes == []
    assert [(m.topic, m.log_time, m.data) for m in again.messages()] == left
    assert 'Traceback' not in capsys.readouterr().err


@pytest.mark.parametrize('seed', range(6))
def test_wrong_cdr_and_schemas_without_checksums(seed: int, tmp_path: Path) -> None:
    """Damage that no checksum shows: lengths inside messages, and schemas of other types."""
    rng = np.random.default_rng([seed, 11])
    bag = open_bag(CASE)
    writer = Writer(str(tmp_path / 'x.mcap'), compression=CompressionType.NONE, enable_crcs=False)
    writer.start(profile='ros2')
    texts = {name: text for s in bag.sources for name, _, text in s.schemas()}
    names = list(texts)
    swapped = dict(zip(names, rng.permutation(names), strict=True)) if seed % 2 else {}
    channels = {}
    for topic, info in bag.topics.items():
        if info.count:
            text = texts[swapped.get(info.type_name, info.type_name)]
            schema = writer.register_schema(info.type_name, 'ros2msg', text.encode())
            channels[topic] = writer.register_channel(topic, 'cdr', schema)
    for message in bag.messages():
        data = bytearray(message.data)
        if seed % 2 == 0 and rng.random() < 0.3:
            at = 4 * int(rng.integers(1, max(len(data) // 4, 2)))
            data[at : at + 4] = struct.pack('<I', int(rng.integers(1, 1 << 32)))
        writer.add_message(channels[message.topic], message.log_time, bytes(data), 0)
    writer.finish()
    assert main(['replay', str(tmp_path / 'x.mcap'), '--arm', 'paredis_table_3']) in (0, 2)


def test_a_state_that_there_is_not_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with BagWriter(tmp_path / 'bag') as writer:
        key = writer.add_topic(
            '/fault_events', message_definition('ft_manip_interfaces/msg/JointFault')
        )
        writer.write(key, cdr(JointFault(name='a', state=208)), 10**18)
    assert main(['replay', str(tmp_path / 'bag'), '--arm', 'paredis_table_3']) == 0
    assert '/fault_events: state: is 208; there are 0 OK, 1 IDLE' in capsys.readouterr().out


@pytest.fixture(scope='module')
def database(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The joint states of the case as a SQLite file."""
    folder = tmp_path_factory.mktemp('sqlite') / 'bag'
    with RosbagsWriter(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        types = get_typestore(Stores.ROS2_JAZZY)
        key = writer.add_connection('/joint_states', 'sensor_msgs/msg/JointState', typestore=types)
        for message in open_bag(CASE).messages(['/joint_states']):
            writer.write(key, message.log_time, message.data)
    return next(folder.glob('*.db3')).read_bytes()


@pytest.mark.parametrize('seed', range(20))
def test_a_damaged_database_is_named_and_leaves_nothing(
    database: bytes, seed: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng([seed, 13])
    data = bytearray(database)
    # Pages after the first ones, which hold the tables of topics and types.
    for at in rng.integers(len(data) // 8, len(data), 40):
        data[at] ^= int(rng.integers(1, 256))
    (tmp_path / 'x.db3').write_bytes(data)
    code = main(['bag', 'recover', str(tmp_path / 'x.db3'), str(tmp_path / 'out')])
    assert code in (0, 2)
    assert (tmp_path / 'out').exists() == (code == 0)
    if code == 2:
        assert 'x.db3: is' in capsys.readouterr().err


def test_damage_inside_a_database_says_how_much_was_read(
    database: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = bytearray(database)
    # The last quarter's pages: their b-tree headers and all.
    data[len(data) * 3 // 4 :] = bytes(len(data) - len(data) * 3 // 4)
    (tmp_path / 'x.db3').write_bytes(data)
    assert main(['bag', 'recover', str(tmp_path / 'x.db3'), str(tmp_path / 'out')]) == 2
    assert 'x.db3: is' in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()


def test_damage_costs_no_memory(tmp_path: Path) -> None:
    """A claim of an exabyte in a chunk's head is refused under a limit of address space."""
    for seed, damage in enumerate((huge_length, huge_uncompressed, flip_bytes)):
        data = damage(bytearray(WHOLE), np.random.default_rng(seed))
        (tmp_path / f'{seed}.mcap').write_bytes(data)
    code = (
        'import sys, pathlib\n'
        'from ft_manip_ros.bags.reader import open_bag\n'
        'for path in pathlib.Path(sys.argv[1]).glob("*.mcap"):\n'
        '    bag = open_bag(path)\n'
        '    print(sum(1 for _ in bag.messages()), len(bag.notes))\n'
    )
    result = subprocess.run(
        [sys.executable, '-c', code, str(tmp_path)],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY)),
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert len(result.stdout.splitlines()) == 3


def test_recover_an_unfinished_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(CASE, tmp_path / 'bag')
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    file = next((tmp_path / 'bag').glob('*.mcap'))
    file.write_bytes(WHOLE[: len(WHOLE) * 2 // 3])
    assert main(['bag', 'recover', str(tmp_path / 'bag')]) == 0
    assert 'messages' in capsys.readouterr().out
    recovered = open_bag(tmp_path / 'bag_recovered')
    assert recovered.notes == []
    assert recovered.message_count > 500
    assert recovered.attachments.keys() == open_bag(CASE).attachments.keys()
    # Never over something that exists.
    assert main(['bag', 'recover', str(tmp_path / 'bag')]) == 2
    assert 'exists already' in capsys.readouterr().err


def test_convert_changes_the_layout_and_nothing_else(tmp_path: Path) -> None:
    code = main(
        ['bag', 'convert', str(CASE), str(tmp_path / 'out'), '--compression', 'none',
         '--split-duration', '5']
    )  # fmt: skip
    assert code == 0
    converted, original = open_bag(tmp_path / 'out'), open_bag(CASE)
    assert len(converted.sources) > 2
    assert list(converted.messages()) == list(original.messages())
    assert {k: v for k, v in converted.provenance.items() if k != 'rosbag2'} == {
        k: v for k, v in original.provenance.items() if k != 'rosbag2'
    }
    for topic, info in original.topics.items():
        if info.count:
            assert converted.topics[topic] == info
    assert copy_bag(original, tmp_path / 'again') == original.message_count


def test_info_says_what_is_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['bag', 'info', str(CASE)]) == 0
    output = capsys.readouterr().out
    assert 'missing' not in output
    assert '/joint_states' in output
    assert 'arm/fault_monitor.yaml' in output
    from mcap.writer import Writer as McapWriter

    writer = McapWriter(str(tmp_path / 'bare.mcap'))
    writer.start(profile='ros2')
    writer.finish()
    assert main(['bag', 'info', str(tmp_path / 'bare.mcap')]) == 0
    output = capsys.readouterr().out
    assert 'missing   no joint_states' in output
    assert 'missing   no parameters of replanner' in output
    assert main(['bag', 'info', str(tmp_path / 'bare.mcap'), '--json']) == 0
