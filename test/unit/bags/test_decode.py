"""Messages are read as another reader reads them, in both byte orders; bad bytes are refused."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rclpy.serialization import serialize_message

from ft_manip_interfaces.srv import InjectFault
from ft_manip_ros.bags.decode import Decoder
from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.core.errors import InputError

CASE = Path(__file__).resolve().parents[3] / 'bags' / 'locked_joint' / 'bag'

TEXT = """# A comment
int32 LARGEST=5
string TEXT = "it is # no comment"
bool yes
byte[] raw
uint8[3] three
float64 number 0.5
string<=10 word "a # b"
string[] words
Inner inner
pkg/Inner[<=4] more
Nothing nothing
int16[2] last  # at the end
================================================================================
MSG: pkg/Inner
int64 a
float32[] b
================================================================================
MSG: pkg/msg/Nothing
"""


class Cdr:
    """Puts CDR bytes together value by value, as the standard says."""

    def __init__(self, order: str) -> None:
        self.order = order
        self.body = b''

    def put(self, code: str, *values: float) -> Cdr:
        for value in values:
            self.body += b'\0' * (-len(self.body) % struct.calcsize(code))
            self.body += struct.pack(self.order + code, value)
        return self

    def text(self, text: str) -> Cdr:
        data = text.encode() + b'\0'
        self.put('I', len(data)).body += data
        return self

    def message(self) -> bytes:
        return (b'\0\1\0\0' if self.order == '<' else b'\0\0\0\0') + self.body


def same(own: Any, other: Any) -> bool:
    """Whether a message is what mcap-ros2-support made of it."""
    if hasattr(other, '__slots__'):
        return all(same(getattr(own, key), getattr(other, key)) for key in other.__slots__)
    if isinstance(other, bytes):
        return bytes(own) == other
    if isinstance(other, list | tuple):
        return len(own) == len(other) and all(map(same, own, other))
    return own == other or (own != own and other != other)


def test_every_type_of_a_recorded_bag_is_read_as_another_reader_reads_it() -> None:
    bag = open_bag(CASE)
    counts: dict[str, int] = {}
    factory = DecoderFactory()
    with next(CASE.glob('*.mcap')).open('rb') as file:
        reader = make_reader(file)
        for record, (schema, _, theirs) in zip(
            bag.messages(), reader.iter_messages(), strict=True
        ):
            assert schema is not None
            name = record.type_name
            # The other reader does not take the types of service events.
            if name.endswith('_Event') or counts.get(name, 0) >= 20:
                continue
            counts[name] = counts.get(name, 0) + 1
            decoder = factory.decoder_for('cdr', schema)
            assert decoder is not None
            assert same(bag.decode(record), decoder(theirs.data)), name
    assert len(counts) > 8


def test_service_events_are_read() -> None:
    event = InjectFault.Event()
    event.info.event_type = event.info.REQUEST_RECEIVED
    event.info.sequence_number = 1 << 40
    event.request = [InjectFault.Request(joint='elbow', kind=InjectFault.Request.SLUGGISH)]
    name = 'ft_manip_interfaces/srv/InjectFault_Event'
    found = Decoder().decode(name, serialize_message(event))
    assert found.info.event_type == event.info.event_type
    assert found.info.sequence_number == 1 << 40
    assert found.info.client_gid.tolist() == [0] * 16
    assert [(part.joint, part.kind) for part in found.request] == [('elbow', 2)]
    assert not found.response


@pytest.mark.parametrize('order', ['<', '>'])
def test_every_kind_of_field_in_both_byte_orders(order: str) -> None:
    cdr = Cdr(order).put('?', True).put('I', 2).put('B', 1, 2).put('B', 7, 8, 9)
    cdr.put('d', 1e-300).text('säge').put('I', 2).text('').text('ab')
    cdr.put('q', -5).put('I', 2).put('f', 0.5, np.nan)
    cdr.put('I', 2).put('q', -5).put('I', 1).put('f', 0.25).put('q', 1 << 60).put('I', 0)
    cdr.put('B', 0).put('h', -1, 300)
    decoder = Decoder()
    decoder.add_schema('pkg/msg/Outer', 'ros2msg', TEXT)
    found = decoder.decode('pkg/msg/Outer', cdr.message())
    assert (found.yes, found.number, found.word, found.words) == (True, 1e-300, 'säge', ['', 'ab'])
    assert found.raw.tolist() == [1, 2]
    assert found.three.tolist() == [7, 8, 9]
    assert [part.a for part in found.more] == [-5, 1 << 60]
    assert found.more[0].b.tolist() == [0.25]
    assert found.inner.a == -5
    assert np.array_equal(found.inner.b, [0.5, np.nan], equal_nan=True)
    assert found.last.tolist() == [-1, 300]
    # ROS's own serialization leaves spare bytes at the end.
    assert decoder.decode('pkg/msg/Outer', cdr.message() + b'spare bytes').last[1] == 300
    for end in range(4, len(cdr.message())):
        with pytest.raises(InputError, match='do not fit its schema'):
            decoder.decode('pkg/msg/Outer', cdr.message()[:end])


def test_idl_schemas_are_read_too() -> None:
    text = (
        '=' * 80 + '\nIDL: pkg/msg/Pair\nmodule pkg { module msg { struct Pair '
        '{ int32 a; sequence<double> b; }; }; };\n'
    )
    decoder = Decoder()
    decoder.add_schema('pkg/msg/Pair', 'ros2idl', text)
    data = b'\0\1\0\0' + struct.pack('<iIdd', 3, 2, 0.5, 1.5)
    found = decoder.decode('pkg/msg/Pair', data)
    assert found.a == 3
    assert found.b.tolist() == [0.5, 1.5]
    with pytest.raises(InputError, match='do not fit'):
        decoder.decode('pkg/msg/Pair', data[:10])
    decoder.add_schema('pkg/msg/Other', 'ros2idl', text)
    with pytest.raises(InputError, match='pkg/msg/Other: does not define it'):
        decoder.decode('pkg/msg/Other', data)


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('what? is this', 'Could not parse'),
        ('Other other', 'pkg/msg/Other'),
        ('Self self', 'recursion'),
        ('wstring text', 'wstring'),
        ('int32 a\n====\nint32 b', 'Could not parse'),
        ('int32 a\n' + '=' * 80 + '\nint32 b', 'Could not parse'),
    ],
)
def test_bad_schemas_are_named(text: str, problem: str) -> None:
    decoder = Decoder()
    decoder.add_schema('pkg/msg/Self', 'ros2msg', text)
    with pytest.raises(InputError, match=f'schema of pkg/msg/Self: is not readable.*{problem}'):
        decoder.decode('pkg/msg/Self', b'\0\1\0\0\0\0\0\0')


def test_an_unknown_encoding_is_named() -> None:
    decoder = Decoder()
    decoder.add_schema('pkg/msg/Self', 'protobuf', 'message Self {}')
    with pytest.raises(InputError, match='ros2msg and ros2idl'):
        decoder.decode('pkg/msg/Self', b'\0\1\0\0\0\0\0\0')


@pytest.mark.parametrize(
    ('text', 'body'),
    [
        ('string[] x', struct.pack('<I', 1 << 31)),
        ('string[] x', struct.pack('<II', 1, 1 << 31)),
        ('float64[] x', struct.pack('<I', 1 << 31)),
        # Even messages without fields, of which any number would fit into nothing.
        ('Nothing[] x\n' + '=' * 80 + '\nMSG: p/Nothing\n', struct.pack('<I', 1 << 31)),
    ],
)
def test_lengths_that_leave_the_message_cost_nothing(text: str, body: bytes) -> None:
    decoder = Decoder()
    decoder.add_schema('p/msg/A', 'ros2msg', text)
    with pytest.raises(InputError, match='do not fit its schema'):
        decoder.decode('p/msg/A', b'\0\1\0\0' + body)
