"""Joint states decoded in blocks are those decoded one by one, whatever comes between."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from ft_manip_ros.bags.definitions import MessageDefinition, message_definition
from ft_manip_ros.bags.joint_blocks import JointBlock, is_joint_state, joint_runs
from ft_manip_ros.bags.reader import Bag, open_bag
from ft_manip_ros.bags.source import BagMessage
from ft_manip_ros.bags.writer import BagWriter
from support.cdr import cdr

TYPE = 'sensor_msgs/msg/JointState'
START = 10**18


def state(i: int, names: Sequence[str] = ('a', 'bcd'), frame: str = 'x') -> JointState:
    message = JointState(name=list(names), position=[0.1 * i + k for k in range(len(names))])
    message.velocity = [-float(i)] * len(names)
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = -5 + i, i
    return message


def write(folder: Path, messages: Sequence[tuple[str, bytes]]) -> Bag:
    with BagWriter(folder) as writer:
        for i, (topic, data) in enumerate(messages):
            kind = 'std_msgs/msg/String' if topic == '/text' else TYPE
            writer.write(writer.add_topic(topic, message_definition(kind)), data, START + i)
    return open_bag(folder)


def decoded(bag: Bag, blocks: set[str]) -> list[tuple[object, ...]]:
    """Everything about each joint state, from whichever way it came."""
    found = []
    for item in joint_runs(bag, set(bag.topics), blocks, None, None):
        if not isinstance(item, JointBlock):
            if item.type_name == TYPE:
                message = bag.decode(item)
                stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
                tables = (message.position, message.velocity, message.effort)
                numbers = tuple(str(table.tolist()) for table in tables)
                found.append((item.topic, stamp, item.log_time, tuple(message.name), *numbers))
            continue
        for k, stamp in enumerate(item.stamps.tolist()):
            tables = (item.positions[k], item.velocities[k], item.efforts[k])
            numbers = tuple(str(table.tolist()) for table in tables)
            found.append((item.topic, stamp, int(item.arrivals[k]), item.names, *numbers))
    return found


def test_blocks_hold_what_single_messages_do(tmp_path: Path) -> None:
    messages = [('/j', cdr(state(i))) for i in range(40)]
    messages[7] = ('/j', cdr(JointState(name=['a', 'bcd'], position=[math.nan, math.inf])))
    messages[12] = ('/text', cdr(String(data='between')))
    # The same size, and other names; names in another number; a name given twice.
    messages[20:23] = [('/j', cdr(state(i, ('b', 'acd')))) for i in (20, 21, 22)]
    messages[30] = ('/j', cdr(state(30, ('a',))))
    messages[33] = ('/j', cdr(state(33, ('a', 'a'))))
    messages[36] = ('/other', cdr(state(36)))
    bag = write(tmp_path / 'bag', messages)
    assert is_joint_state(bag, '/j')
    assert not is_joint_state(bag, '/text')
    assert decoded(bag, {'/j', '/other'}) == decoded(bag, set())
    items = list(joint_runs(bag, set(bag.topics), {'/j'}, None, None))
    sizes = [len(item.stamps) if isinstance(item, JointBlock) else 1 for item in items]
    assert max(sizes) > 5
    assert sum(sizes) == 40


def test_bytes_that_align_mean_nothing(tmp_path: Path) -> None:
    """rclpy leaves whatever was in memory there."""
    plain = cdr(state(1))
    at = plain.index(b'x\0') + 2
    other = bytearray(cdr(state(2)))
    other[at : at + 2] = b'??'
    bag = write(tmp_path / 'bag', [('/j', plain), ('/j', bytes(other))])
    (block,) = joint_runs(bag, ['/j'], ['/j'], None, None)
    assert isinstance(block, JointBlock)
    assert np.array_equal(block.positions[:, 0], [0.1, 0.2])


def test_another_definition_of_the_type_is_left_to_the_decoder(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as writer:
        key = writer.add_topic('/j', MessageDefinition(TYPE, 'int32 number', ''))
        writer.write(key, b'\0\1\0\0\5\0\0\0', START)
    bag = open_bag(tmp_path / 'bag')
    assert not is_joint_state(bag, '/j')


@pytest.mark.parametrize('length', [5, 30, 60])
def test_messages_cut_short_are_handed_on(tmp_path: Path, length: int) -> None:
    whole = cdr(state(1))
    bag = write(tmp_path / 'bag', [('/j', whole), ('/j', whole[:length]), ('/j', whole)])
    before, cut, after = joint_runs(bag, ['/j'], ['/j'], None, None)
    assert isinstance(cut, BagMessage)
    assert cut.data == whole[:length]
    for block in (before, after):
        assert isinstance(block, JointBlock)
        assert block.stamps.tolist() == [-4 * 10**9 + 1]


@pytest.mark.parametrize('count', [11, 12, 500, 2500])
def test_long_runs_are_decoded_where_they_lie(tmp_path: Path, count: int) -> None:
    messages = [('/j', cdr(state(i))) for i in range(count)]
    messages[count // 2] = ('/j', cdr(state(1, ('bcd', 'a'))))
    bag = write(tmp_path / 'bag', [*messages, ('/text', cdr(String(data='behind')))])
    found = decoded(bag, {'/j'})
    assert found == decoded(bag, set())
    assert len(found) == count
