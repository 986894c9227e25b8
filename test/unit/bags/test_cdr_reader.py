"""The CDR reader agrees with rosbags in both byte orders; bad bytes are refused."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ft_manip_ros.bags.cdr_reader import CdrError, CdrReader
from ft_manip_ros.bags.decode import Decoder
from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.bags.schema import Field, SchemaError, parse_schema
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


def rosbags_store(text: str, type_name: str) -> tuple[Any, str]:
    store = get_typestore(Stores.EMPTY)
    types = get_types_from_msg(text, type_name)
    store.register(types)
    return store, next(iter(types))


def same(own: Any, other: Any) -> bool:
    if isinstance(own, np.ndarray):
        # rosbags holds byte to be signed.
        kinds = {own.dtype.str, other.dtype.str}
        return (len(kinds) == 1 or kinds == {'|u1', '|i1'}) and np.array_equal(
            own, other, equal_nan=own.dtype.kind == 'f'
        )
    if isinstance(own, list):
        return len(own) == len(other) and all(map(same, own, other))
    if hasattr(own, '__slots__'):
        return all(same(getattr(own, key), getattr(other, key)) for key in own.__slots__)
    return type(own) is type(other) and (own == other or own != own)


def test_every_type_of_a_recorded_bag_is_read_as_rosbags_reads_it() -> None:
    bag = open_bag(CASE)
    # As the bag has them: the installed definitions may have grown since.
    texts = {name: text for source in bag.sources for name, _, text in source.schemas()}
    counts: dict[str, int] = {}
    stores = {}
    for record in bag.messages():
        name = record.type_name
        counts[name] = counts.get(name, 0) + 1
        if counts[name] > 20:
            continue
        if name not in stores:
            stores[name] = rosbags_store(texts[name], name)
        store, other_name = stores[name]
        definition = store.get_msgdef(other_name)
        other, _ = definition.deserialize_cdr_le(record.data[4:], 0, definition.cls, store)
        assert same(bag.decode(record), other), name
    assert len(counts) > 8


@pytest.mark.parametrize('little', [True, False])
def test_every_kind_of_field_in_both_byte_orders(little: bool) -> None:
    store, name = rosbags_store(TEXT, 'pkg/msg/Outer')
    kinds = store.types
    inner, nothing = kinds['pkg/msg/Inner'], kinds['pkg/msg/Nothing']
    one = inner(a=-5, b=np.array([0.5, np.nan], dtype=np.float32))
    outer = kinds[name](
        yes=True,
        raw=np.array([1, 2], dtype=np.uint8),
        three=np.array([7, 8, 9], dtype=np.uint8),
        number=1e-300,
        word='säge',
        words=['', 'ab'],
        inner=one,
        more=[one, inner(a=1 << 60, b=np.array([], dtype=np.float32))],
        nothing=nothing(structure_needs_at_least_one_member=0),
        last=np.array([-1, 300], dtype=np.int16),
    )
    data = bytes(store.serialize_cdr(outer, name, little_endian=little))
    decoder = Decoder()
    decoder.add_schema('pkg/msg/Outer', 'ros2msg', TEXT)
    found = decoder.decode('pkg/msg/Outer', data)
    assert (found.yes, found.number, found.word, found.words) == (True, 1e-300, 'säge', ['', 'ab'])
    assert found.raw.tolist() == [1, 2]
    assert found.three.tolist() == [7, 8, 9]
    assert [part.a for part in found.more] == [-5, 1 << 60]
    assert np.array_equal(found.inner.b, [0.5, np.nan], equal_nan=True)
    assert found.last.tolist() == [-1, 300]
    assert repr(found).startswith('Outer(yes=True')


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


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('what? is this', 'neither field nor constant'),
        ('Other other', 'no definition of pkg/Other'),
        ('Self self', 'contains itself'),
        ('wstring text', 'wstring'),
        ('int32 a\n====\nint32 b', 'has no name'),
    ],
)
def test_bad_schemas_are_named(text: str, problem: str) -> None:
    decoder = Decoder()
    decoder.add_schema('pkg/msg/Self', 'ros2msg', text)
    with pytest.raises(InputError, match=problem):
        decoder.decode('pkg/msg/Self', b'\0\1\0\0\0\0\0\0')


def test_lengths_that_leave_the_message_cost_nothing() -> None:
    types = {'p/A': (Field('x', 'p/B', -1),), 'p/B': (Field('y', 'string', None),)}
    reader = CdrReader(types, '<').reader('p/A')
    for body in (struct.pack('<I', 1 << 31), struct.pack('<II', 1, 1 << 31)):
        with pytest.raises(CdrError):
            reader(body, 0)
    numbers = CdrReader({'p/A': (Field('x', 'float64', -1),)}, '<').reader('p/A')
    with pytest.raises(CdrError, match='leaves the message'):
        numbers(struct.pack('<I', 1 << 31), 0)
    with pytest.raises(SchemaError):
        CdrReader({}, '<').reader('p/A')
    assert parse_schema('int32 a', 'p/msg/A') == {'p/A': (Field('a', 'int32', None),)}
