"""Arm files: what is read, what is refused and how it is named, and what is written back."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from ft_manip_ros.core.arm_file import load_arm, load_dh, save_dh
from ft_manip_ros.core.config_files import config_folder
from ft_manip_ros.core.dh import DhTable
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.joint import Joint
from ft_manip_ros.core.kinematics import fk

# Table 3 of Paredis & Khosla (1994): d, a, alpha in degrees.
PAREDIS_TABLE_3 = [
    (0.2, 0.7, 90.0),
    (0.1, 1.0, 0.0),
    (0.9, 0.1, 135.0),
    (0.6, 0.5, 0.0),
    (0.1, 1.3, 0.0),
]

GOOD = """
name: arm
convention: standard_dh
joints:
  - {name: j1, d: 0.2, a: 0.7, alpha_deg: 90, lower_deg: -150, upper_deg: 150}
  - {name: j2, d: 1e-1, a: 1, alpha: 0.5, offset_deg: 90, velocity: 2.5, acceleration: 9}
  - {name: j3, type: prismatic, d: 0, a: 0, lower: 0, upper: 0.4, operating_upper: 0.3}
"""


def _write(folder: Path, text: str) -> str:
    path = folder / 'arm.yaml'
    path.write_text(text)
    return str(path)


def test_every_field_is_read(tmp_path: Path) -> None:
    table = load_dh(_write(tmp_path, GOOD))
    assert [joint.name for joint in table.joints] == ['j1', 'j2', 'j3']
    assert table.d.tolist() == [0.2, 0.1, 0.0]
    assert table.a.tolist() == [0.7, 1.0, 0.0]
    assert table.alpha == pytest.approx([math.pi / 2, 0.5, 0.0])
    assert table.offset == pytest.approx([0.0, math.pi / 2, 0.0])
    first, second, third = table.joints
    assert (first.lower, first.upper) == pytest.approx((-2.6179938779914944, 2.6179938779914944))
    assert not first.wraps
    assert (second.lower, second.upper) == (-math.pi, math.pi)
    assert second.wraps
    assert (second.velocity, second.acceleration) == (2.5, 9.0)
    assert third.prismatic
    assert third.operating == (0.0, 0.3)


def test_the_papers_table_3_is_as_printed() -> None:
    table = load_dh('paredis_table_3')
    rows = np.column_stack([table.d, table.a, np.rad2deg(table.alpha)])
    assert rows == pytest.approx(np.array(PAREDIS_TABLE_3))
    assert np.rad2deg([joint.upper for joint in table.joints]) == pytest.approx([150.0] * 5)


def test_the_papers_table_1_offsets_cancel() -> None:
    table = load_dh('paredis_table_1')
    assert table.d.sum() == pytest.approx(0.0)
    assert all(joint.wraps for joint in table.joints)
    # Stretched out: five unit links in a row.
    assert fk(table.chain(), np.zeros(5))[1] == pytest.approx([5.0, 0.0, 0.0], abs=1e-15)


@pytest.mark.parametrize(
    'path', sorted(config_folder('arms').glob('*.yaml')), ids=lambda p: p.stem
)
def test_every_arm_of_the_package_loads_by_its_name(path: Path) -> None:
    assert load_arm(path.stem).name == path.stem
    assert load_arm(f'{path.stem}.yaml').n == load_arm(str(path)).n


def test_a_saved_table_reads_back_the_same(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    joints = (
        Joint('a', -1.0, 2.0, -0.5, 1.0, 1.5, 3.0),
        Joint('slide', 0.0, 0.3, prismatic=True),
        Joint('c'),
    )
    table = DhTable('made up', joints, *rng.normal(size=(4, 3)))
    path = tmp_path / 'out.yaml'
    save_dh(table, path)
    again = load_dh(path)
    assert again.name == table.name
    assert again.joints == table.joints
    for column in ('d', 'a', 'alpha', 'offset'):
        assert (getattr(again, column) == getattr(table, column)).all()
    assert [entry.name for entry in tmp_path.iterdir()] == ['out.yaml']


def test_saving_into_a_missing_folder_says_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'cannot be written'):
        save_dh(load_dh('planar_3r'), tmp_path / 'nowhere' / 'arm.yaml')


REFUSED = {
    'unknown key': ('a: 0.7', 'a: 0.7, twist: 3', r'joints\[0\]\.twist: is not a known key'),
    'both units': ('alpha_deg: 90', 'alpha_deg: 90, alpha: 1', r'joints\[0\]\.alpha: is given'),
    'not a number': ('d: 0.2', 'd: high', r"joints\[0\]\.d: is 'high'; a number"),
    'a flag': ('d: 0.2', 'd: true', r'joints\[0\]\.d: is True; a number'),
    'nan': ('d: 0.2', 'd: .nan', r'joints\[0\]\.d: is nan; a finite'),
    'infinity': ('a: 0.7', 'a: .inf', r'joints\[0\]\.a: is inf; a finite'),
    'huge': ('a: 0.7', 'a: 1' + '0' * 400, r'joints\[0\]\.a: is inf; a finite'),
    'empty': ('a: 0.7', 'a: ', r'joints\[0\]\.a: is empty'),
    'missing': ('a: 0.7, ', '', r'joints\[0\]\.a: is missing'),
    'no twist': ('alpha_deg: 90, ', '', r'joints\[0\]\.alpha: is missing'),
    'sexagesimal': ('d: 0.2', 'd: 1:30', r"joints\[0\]\.d: is '1:30'"),
    'duplicate name': ('name: j2', 'name: j1', r"joints\[1\]\.name: 'j1' names two joints"),
    'duplicate key': ('d: 0.2', 'd: 0.2, d: 0.3', r"line 5: is not valid YAML: key 'd' is given"),
    'half a limit': ('lower_deg: -150, ', '', r'joints\[0\]\.lower: is missing; give both'),
    'empty range': ('lower_deg: -150', 'lower_deg: 170', r'joints\[0\].*lower .* is not below'),
    'operating outside': ('upper: 0.3', 'upper: 0.5', r'joints\[2\].*leave the physical limits'),
    'degrees of a slide': ('lower: 0,', 'lower_deg: 0,', r'joints\[2\]\.lower_deg: is an angle'),
    'a slide without limits': ('lower: 0, upper: 0.4,', '', r'joints\[2\].lower: is missing'),
    'unknown type': ('prismatic', 'spherical', r'joints\[2\]\.type: .*revolute, prismatic'),
    'unknown convention': ('standard_dh', 'modified_dh', r"convention: is 'modified_dh'"),
    'speed zero': ('velocity: 2.5', 'velocity: 0', r'joints\[1\].*velocity: is 0; must be > 0'),
    'syntax': ('d: 0.2,', 'd: 0.2,, ', r'arm\.yaml, line 5: is not valid YAML'),
    'no name': ('name: arm', '', r'arm\.yaml: name: is missing'),
    'name not text': ('name: arm', 'name: 3', r'name: is 3; a text'),
    'joint not a mapping': ('- {name: j3', '- 5\n  - {name: j3', r'joints\[2\]: is 5; a mapping'),
}


@pytest.mark.parametrize('case', REFUSED)
def test_what_is_wrong_is_named(case: str, tmp_path: Path) -> None:
    old, new, message = REFUSED[case]
    assert old in GOOD
    with pytest.raises(InputError, match=message) as raised:
        load_dh(_write(tmp_path, GOOD.replace(old, new, 1)))
    assert 'arm.yaml' in str(raised.value)


@pytest.mark.parametrize('text', ['', '[]', 'text', '3', 'joints: []', 'name: a\njoints: {}'])
def test_files_of_another_shape_are_refused(text: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'arm\.yaml'):
        load_dh(_write(tmp_path, text))


def test_bytes_that_are_not_text_are_refused(tmp_path: Path) -> None:
    path = tmp_path / 'arm.yaml'
    path.write_bytes(b'name: \xff\xfe')
    with pytest.raises(InputError, match='not UTF-8'):
        load_dh(path)


def test_unknown_arms_are_refused_with_the_names_there_are(tmp_path: Path) -> None:
    with pytest.raises(InputError, match='paredis_table_1, paredis_table_2'):
        load_arm('paredis_table_9')
    with pytest.raises(InputError, match='is not a file'):
        load_arm(str(tmp_path / 'none.yaml'))
    with pytest.raises(InputError, match='is a folder'):
        load_arm(str(tmp_path))
    with pytest.raises(InputError, match='is empty'):
        load_arm('')
    with pytest.raises(InputError, match='only URDFs have links'):
        load_arm('planar_3r', tip='tool')
    with pytest.raises(InputError, match="no package 'not_there'"):
        load_arm('package://not_there/arm.urdf')
