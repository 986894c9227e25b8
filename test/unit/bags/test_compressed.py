"""Bags under rosbag2's own compression, as rosbags writes it: files or messages in zstd."""

from __future__ import annotations

import gc
from pathlib import Path

import pytest
import zstandard
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from std_msgs.msg import String

from ft_manip_ros.bags.compressed import unpack_message
from ft_manip_ros.bags.copy import copy_bag
from ft_manip_ros.bags.definitions import message_definition
from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.core.errors import InputError
from support.cdr import cdr

STRING = 'std_msgs/msg/String'
START = 10**18
EXPECTED = [f'message {i} {"x" * (i % 7)}' for i in range(300)]
BOMB = zstandard.ZstdCompressor().compress(bytes(1 << 29))


def write(folder: Path, plugin: StoragePlugin, mode: CompressionMode) -> None:
    definition = message_definition(STRING)
    writer = RosbagsWriter(folder, version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection(
            '/text', STRING, msgdef=definition.text, rihs01=definition.type_hash
        )
        for i, text in enumerate(EXPECTED):
            writer.write(connection, START + i, cdr(String(data=text)))


@pytest.mark.parametrize('plugin', list(StoragePlugin))
@pytest.mark.parametrize('mode', [CompressionMode.FILE, CompressionMode.MESSAGE])
@pytest.mark.parametrize('with_metadata', [True, False])
def test_packed_bags_are_read_and_copied(
    tmp_path: Path, plugin: StoragePlugin, mode: CompressionMode, with_metadata: bool
) -> None:
    write(tmp_path / 'bag', plugin, mode)
    packed = any(path.suffix == '.zstd' for path in (tmp_path / 'bag').iterdir())
    assert packed == (mode is CompressionMode.FILE)
    if not with_metadata:
        (tmp_path / 'bag' / 'metadata.yaml').unlink()
    bag = open_bag(tmp_path / 'bag')
    assert [bag.decode(message).data for message in bag.messages()] == EXPECTED
    assert bag.message_count == len(EXPECTED)
    copy_bag(bag, tmp_path / 'plain')
    plain = open_bag(tmp_path / 'plain')
    assert [plain.decode(message).data for message in plain.messages()] == EXPECTED
    folders = [file.path.parent for file in bag.unpacked]
    assert len(folders) == (mode is CompressionMode.FILE)
    del bag
    gc.collect()
    assert not any(folder.exists() for folder in folders)


def test_a_packed_file_that_was_cut_off_gives_its_beginning(tmp_path: Path) -> None:
    write(tmp_path / 'bag', StoragePlugin.MCAP, CompressionMode.FILE)
    file = next((tmp_path / 'bag').glob('*.zstd'))
    # A zstd block is lost as a whole: pack the file again in many.
    packer = zstandard.ZstdCompressor(level=1).compressobj()
    content = zstandard.ZstdDecompressor().decompressobj().decompress(file.read_bytes())
    blocks = [content[at : at + 500] for at in range(0, len(content), 500)]
    packed = b''.join(
        packer.compress(block) + packer.flush(zstandard.COMPRESSOBJ_FLUSH_BLOCK)
        for block in blocks
    )
    file.write_bytes(packed[: len(packed) // 2])
    bag = open_bag(file)
    texts = [bag.decode(message).data for message in bag.messages()]
    assert texts == EXPECTED[: len(texts)]
    assert len(texts) < len(EXPECTED)
    assert bag.notes


def test_a_file_that_is_there_packed_and_unpacked_counts_once(tmp_path: Path) -> None:
    write(tmp_path / 'bag', StoragePlugin.MCAP, CompressionMode.FILE)
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    file = next((tmp_path / 'bag').glob('*.zstd'))
    content = zstandard.ZstdDecompressor().decompressobj().decompress(file.read_bytes())
    file.with_suffix('').write_bytes(content)
    assert open_bag(tmp_path / 'bag').message_count == len(EXPECTED)


def test_what_is_packed_and_no_bag_is_named(tmp_path: Path) -> None:
    (tmp_path / 'x.mcap.zstd').write_bytes(b'no zstd at all')
    with pytest.raises(InputError, match='MCAP'):
        open_bag(tmp_path / 'x.mcap.zstd')
    (tmp_path / 'x.txt.zstd').write_bytes(b'')
    with pytest.raises(InputError, match='neither'):
        open_bag(tmp_path / 'x.txt.zstd')


@pytest.mark.parametrize('data', [BOMB, BOMB[:20], b'\x28\xb5\x2f\xfd', b''])
def test_damaged_messages_stay_as_they_are(data: bytes) -> None:
    assert unpack_message(data) == data
