"""URDFs in and out: against Pinocchio's own reading, real arms, round trips, refusals."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.config_files import config_folder, resolve_package_url
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.joint import DEFAULT_VELOCITY, Joint
from ft_manip_ros.core.kinematics import fk, jacobian
from ft_manip_ros.core.pinocchio_model import model_from_chain
from ft_manip_ros.core.urdf import chain_from_urdf
from ft_manip_ros.core.urdf_writer import chain_to_urdf
from support.chains import REAL_ARMS, random_chain, random_posture

ARM = """<?xml version="1.0" encoding="UTF-8"?>
<robot name="small">
  <link name="ground"/>
  <link name="base"/>
  <link name="upper"><visual><geometry><mesh filename="package://gone/upper.stl"/></geometry></visual>
    <collision><geometry><mesh filename="package://gone/upper.stl"/></geometry></collision></link>
  <link name="slider"/>
  <link name="wrist"/>
  <link name="finger"/>
  <link name="thumb"/>
  <joint name="mount" type="fixed">
    <parent link="ground"/><child link="base"/><origin xyz="0 0 0.3" rpy="0 0 1.5707963267948966"/>
  </joint>
  <joint name="roll" type="continuous">
    <parent link="slider"/><child link="wrist"/><origin xyz="0.1 0 0"/><axis xyz="1 0 0"/>
    <limit effort="1" velocity="3"/>
  </joint>
  <joint name="lift" type="prismatic">
    <parent link="upper"/><child link="slider"/><origin xyz="0 0.2 0" rpy="0.3 0 0"/>
    <axis xyz="0 -1 0"/>
    <limit lower="-0.1" upper="0.4" effort="1" velocity="0.5"/>
  </joint>
  <joint name="turn" type="revolute">
    <parent link="base"/><child link="upper"/><origin xyz="0 0 0.5"/><axis xyz="0.6 0 0.8"/>
    <limit lower="-2" upper="1.5" effort="1" velocity="0" acceleration="7"/>
    <safety_controller soft_lower_limit="-1.8" soft_upper_limit="9" k_position="1" k_velocity="1"/>
  </joint>
  <joint name="grip" type="revolute">
    <parent link="wrist"/><child link="finger"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="grip_too" type="revolute">
    <parent link="wrist"/><child link="thumb"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/><mimic joint="grip" multiplier="-1"/>
  </joint>
</robot>
"""


def _turn(axis: list[float], angle: float) -> np.ndarray:
    """Rodrigues' formula."""
    k = np.array(axis)
    cross = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def test_a_small_arm_by_hand() -> None:
    # Joints stand from tip to base in the file, and its meshes do not exist.
    chain = chain_from_urdf(ARM, tip='wrist')
    assert chain.joint_names == ('turn', 'lift', 'roll')
    turn, lift, roll = chain.joints
    assert (turn.lower, turn.upper, turn.velocity, turn.acceleration) == (
        -2.0,
        1.5,
        DEFAULT_VELOCITY,
        7.0,
    )
    assert turn.operating == (-1.8, 1.5)
    assert lift.prismatic
    assert (lift.lower, lift.upper) == (-0.1, 0.4)
    assert (roll.lower, roll.upper, roll.wraps) == (-np.pi, np.pi, True)
    q = np.array([0.7, 0.25, -2.0])
    r = _turn([0, 0, 1], np.pi / 2) @ _turn([0.6, 0, 0.8], q[0])
    p = np.array([0, 0, 0.8]) + r @ [0, 0.2, 0]
    r = r @ _turn([1, 0, 0], 0.3)
    p = p + r @ [0.1, -q[1], 0]
    rotation, position = fk(chain, q)
    assert np.abs(position - p).max() < 1e-14
    assert np.abs(rotation - r @ _turn([1, 0, 0], q[2])).max() < 1e-14
    # From another base, what lies before it is left out.
    assert chain_from_urdf(ARM, 'upper', 'wrist').joint_names == ('lift', 'roll')


@pytest.mark.parametrize('arm', REAL_ARMS)
def test_real_arms_agree_with_pinocchio_on_the_whole_robot(arm: str) -> None:
    url, base, tip, joints = REAL_ARMS[arm]
    chain = load_arm(url, base=base, tip=tip)
    assert chain.n == joints
    model = pinocchio.buildModelFromUrdf(str(resolve_package_url(url)))
    data = model.createData()
    rng = np.random.default_rng(3)
    base_id = model.getFrameId(base, pinocchio.FrameType.BODY)
    tip_id = model.getFrameId(tip, pinocchio.FrameType.BODY)
    for _ in range(20):
        whole = pinocchio.neutral(model)
        q = random_posture(chain, rng)
        for name, value in zip(chain.joint_names, q, strict=True):
            joint = model.joints[model.getJointId(name)]
            if joint.nq == 2:
                whole[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
            else:
                whole[joint.idx_q] = value
        pinocchio.framesForwardKinematics(model, data, whole)
        expected = data.oMf[base_id].inverse() * data.oMf[tip_id]
        rotation, position = fk(chain, q)
        assert np.abs(rotation - expected.rotation).max() < 1e-12
        assert np.abs(position - expected.translation).max() < 1e-12
        columns = pinocchio.computeFrameJacobian(
            model, data, whole, tip_id, pinocchio.LOCAL_WORLD_ALIGNED
        )
        ids = [model.joints[model.getJointId(name)].idx_v for name in chain.joint_names]
        turned = data.oMf[base_id].rotation.T
        assert np.abs(turned @ columns[:3, ids] - jacobian(chain, q)[:3]).max() < 1e-12
        assert np.abs(turned @ columns[3:, ids] - jacobian(chain, q)[3:]).max() < 1e-12


def _assert_same(chain: SerialChain, again: SerialChain) -> None:
    assert again.joints == chain.joints
    rng = np.random.default_rng(4)
    for _ in range(5):
        q = random_posture(chain, rng)
        for a, b in zip(fk(chain, q), fk(again, q), strict=True):
            assert np.abs(a - b).max() < 1e-12


@pytest.mark.parametrize('arm', REAL_ARMS)
def test_real_arms_written_and_read_are_the_same(arm: str) -> None:
    url, base, tip, _ = REAL_ARMS[arm]
    chain = load_arm(url, base=base, tip=tip)
    _assert_same(chain, load_arm(chain_to_urdf(chain)))


def test_dh_arms_and_random_chains_written_and_read_are_the_same() -> None:
    rng = np.random.default_rng(5)
    chains = [load_arm(path.stem) for path in config_folder('arms').glob('*.yaml')]
    chains += [random_chain(rng) for _ in range(100)]
    for chain in chains:
        _assert_same(chain, chain_from_urdf(chain_to_urdf(chain)))


def test_names_with_markup_survive_and_impossible_ones_are_refused() -> None:
    made = SerialChain(
        'a & "b"', (Joint('<j & 1>', -1.0, 1.0),), np.array([np.eye(3)] * 2), np.ones((2, 3))
    )
    again = chain_from_urdf(chain_to_urdf(made))
    assert (again.name, again.joint_names) == (made.name, made.joint_names)
    odd = SerialChain('x', (Joint('\x00', -1.0, 1.0),), made.rotations, made.translations)
    with pytest.raises(InputError, match='XML'):
        chain_to_urdf(odd)


def test_the_model_of_a_full_turn_has_one_coordinate() -> None:
    chain = load_arm('paredis_table_1')
    model = model_from_chain(chain)
    assert model.nq == model.nv == chain.n


def test_equal_limits_fix_a_joint() -> None:
    text = ARM.replace('lower="-0.1" upper="0.4"', 'lower="0.2" upper="0.2"')
    chain, whole = chain_from_urdf(text, tip='wrist'), chain_from_urdf(ARM, tip='wrist')
    assert chain.joint_names == ('turn', 'roll')
    for a, b in zip(fk(chain, [0.3, 1.0]), fk(whole, [0.3, 0.2, 1.0]), strict=True):
        assert np.abs(a - b).max() < 1e-14


REFUSED = {
    'no tip chosen': (None, None, '', '', r'tip: is needed.*2 end links: finger, thumb'),
    'unknown tip': (None, 'hand', '', '', r"tip: 'hand' is not a link; links: ground, base"),
    'unknown base': ('floor', 'wrist', '', '', r"base: 'floor' is not a link"),
    'not below': ('finger', 'wrist', '', '', r"'wrist' is not below the base 'finger'"),
    'mimic': (None, 'thumb', '', '', r"joint 'grip_too': has no range left"),
    'nothing moves': ('ground', 'base', '', '', r'no joint moves'),
    'floating': (
        None,
        'wrist',
        'type="continuous"',
        'type="floating"',
        r"'roll': has 6 deg",
    ),
    'limits swapped': (None, 'wrist', 'lower="-2" upper="1.5"', 'lower="2" upper="1.5"', r'turn'),
    'not xml': (
        None,
        'wrist',
        '<link name="ground"/>',
        '<link name="ground">',
        r'line \d+: is not',
    ),
    'not a robot': (None, 'wrist', 'robot', 'arm', r'<arm> at its root'),
    'acceleration': (None, 'wrist', '"7"', '"fast"', r"acceleration: is 'fast'; a finite"),
    'unknown type': (None, 'wrist', 'type="revolute"', 'type="rotary"', r'Pinocchio'),
}


@pytest.mark.parametrize('case', REFUSED)
def test_what_is_wrong_is_named(case: str) -> None:
    base, tip, old, new, message = REFUSED[case]
    text = ARM.replace(old, new) if old else ARM
    assert not old or text != ARM
    with pytest.raises(InputError, match=message):
        chain_from_urdf(text, base, tip)


def test_xacro_and_missing_files_are_refused() -> None:
    with pytest.raises(InputError, match='expand it first'):
        chain_from_urdf('<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm/></robot>')
    with pytest.raises(InputError, match='cannot be read'):
        chain_from_urdf('/nowhere/arm.urdf')
