"""Three-roll wrists: recognised, and their failures made good as the argument says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.ftws.directions import directions
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import Verdict
from ft_manip_ros.core.ftws.wrist import find_wrist
from ft_manip_ros.core.joint import Joint
from ft_manip_ros.core.kinematics import fk
from support.chains import random_rotation

TABLE_2 = load_arm('paredis_table_2')
UP, ACROSS = np.eye(3), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def with_wrist(*arm: tuple[Joint, np.ndarray, np.ndarray], tool: float = 0.0) -> SerialChain:
    """Joints, each with its placement (rotation, translation), before a three-roll wrist."""
    rolls = [Joint(f'roll_{k}') for k in range(3)]
    placements = [(UP, np.array([0.0, 0.0, 0.2])), (ACROSS, np.zeros(3)), (ACROSS.T, np.zeros(3))]
    rotations = [r for _, r, _ in arm] + [r for r, _ in placements] + [random_rotation(RNG)]
    translations = [t for *_, t in arm] + [t for _, t in placements] + [[0.0, 0.0, tool]]
    joints = tuple(joint for joint, *_ in arm) + tuple(rolls)
    return SerialChain('with wrist', joints, np.array(rotations), np.array(translations))


RNG = np.random.default_rng(0)


def slide(name: str, axis: int) -> tuple[Joint, np.ndarray, np.ndarray]:
    """A slide along an axis of the base; the next placement has to turn back."""
    turn = Rotation.align_vectors([np.eye(3)[axis]], [[0.0, 0.0, 1.0]])[0].as_matrix()
    joint = Joint(name, -1.0, 1.0, operating_lower=-0.5, operating_upper=0.5, prismatic=True)
    return joint, turn, np.zeros(3)


def gantry(tool: float = 0.0) -> SerialChain:
    """Two slides along each axis, and a wrist that always hangs the same way."""
    joints, made, before = [], [], np.eye(3)
    for k in range(6):
        joint, turn, shift = slide(f'slide_{k}', k % 3)
        made.append((joint, before.T @ turn, shift))
        before = turn
        joints.append(joint)
    return with_wrist(*made, tool=tool)


def test_the_wrist_of_table_2_is_recognised_and_its_point_is_the_tool() -> None:
    wrist = find_wrist(TABLE_2)
    assert wrist is not None and wrist.middle == 6
    assert wrist.arm.joint_names == TABLE_2.joint_names[:5]
    for q in np.random.default_rng(1).uniform(-3.0, 3.0, (5, 8)):
        rotation, point = fk(TABLE_2, q)
        forearm, wrist_point = fk(wrist.arm, q[:5])
        np.testing.assert_allclose(wrist_point, point, atol=1e-12)
        for angle, way in wrist.along:
            bent = fk(TABLE_2, [*q[:6], angle, q[7]])[0] @ wrist.axis
            np.testing.assert_allclose(bent, way * forearm[:, 2], atol=1e-12)
        # The axis of the last roll stays where it is in the tool.
        other = fk(TABLE_2, [*q[:7], q[7] + 1.0])[0]
        np.testing.assert_allclose(other @ wrist.axis, rotation @ wrist.axis, atol=1e-12)


@pytest.mark.parametrize(
    'change',
    ['limits', 'tilt', 'tool', 'offset'],
)
def test_what_only_looks_like_one_is_not_taken_for_it(change: str) -> None:
    assert find_wrist(gantry()) is not None
    chain = gantry(tool=0.05) if change == 'offset' else gantry()
    rotations, translations = chain.rotations.copy(), chain.translations.copy()
    joints = list(chain.joints)
    if change == 'limits':
        joints[7] = Joint('roll_1', -3.0, 3.0)
    elif change == 'tilt':
        rotations[7] = rotations[7] @ Rotation.from_rotvec([0.01, 0.0, 0.0]).as_matrix()
    elif change == 'tool':
        translations[-1] = [0.01, 0.0, 0.0]
    changed = replace(chain, joints=tuple(joints), rotations=rotations, translations=translations)
    found = find_wrist(changed)
    # A tool along the last axis is off the point where all three meet.
    assert found is None


def wrist_angles(orientation: np.ndarray, q: np.ndarray, fixed: int, angle: float) -> np.ndarray:
    """The two free wrist joints that give Table 2 this orientation, solved numerically."""
    free = [k for k in (5, 6, 7) if k != fixed]

    def off(x: np.ndarray) -> np.ndarray:
        posture = q.copy()
        posture[fixed], posture[free] = angle, x
        return Rotation.from_matrix(fk(TABLE_2, posture)[0] @ orientation.T).as_rotvec()

    starts = [(a, b) for a in (-2.0, 0.0, 2.0) for b in (-2.0, 0.0, 2.0)]
    best = min((least_squares(off, start) for start in starts), key=lambda r: float(r.cost))
    posture = q.copy()
    posture[fixed], posture[free] = angle, best.x
    return posture


@pytest.mark.parametrize('fixed', [5, 6, 7])
def test_a_forearm_that_points_as_the_argument_says_makes_good_a_lost_roll(fixed: int) -> None:
    """Table 2 at one place, random orientations and frozen angles."""
    wrist = find_wrist(TABLE_2)
    assert wrist is not None
    rng = np.random.default_rng(fixed)
    place = np.array([1.0, 0.2, 0.1])
    for _ in range(3):
        orientation, angle = Rotation.random(random_state=rng).as_matrix(), rng.uniform(-3.0, 3.0)
        t = orientation @ wrist.axis
        if fixed == 5:
            f = t
        elif fixed == 6:
            # The angle between forearm and last roll that this frozen joint leaves.
            bent = np.array([0.0] * 6 + [angle, 0.0])
            cosine = fk(wrist.arm, np.zeros(5))[0][:, 2] @ fk(TABLE_2, bent)[0] @ wrist.axis
            across = np.cross(t, rng.normal(size=3))
            f = cosine * t + np.sqrt(1.0 - cosine**2) * across / np.linalg.norm(across)
        else:
            # The middle axis as the frozen last roll leaves it in the tool.
            held = np.array([0.0] * 7 + [angle])
            last = fk(TABLE_2, held)[0]
            middle = fk(TABLE_2, held + np.eye(8)[6])[0] @ last.T
            axis = Rotation.from_matrix(middle).as_rotvec()
            u = orientation @ last.T @ axis
            f = np.cross(u, rng.normal(size=3))
            f /= np.linalg.norm(f)

        def off(x: np.ndarray, f: np.ndarray = f) -> np.ndarray:
            rotation, point = fk(wrist.arm, x)
            return np.concatenate([point - place, rotation[:, 2] - f])

        starts = rng.uniform(-np.pi, np.pi, (200, 5))
        arm = next(r.x for s in starts if (r := least_squares(off, s)).cost < 1e-20)
        posture = wrist_angles(orientation, np.concatenate([arm, np.zeros(3)]), fixed, angle)
        rotation, point = fk(TABLE_2, posture)
        np.testing.assert_allclose(point, place, atol=1e-9)
        np.testing.assert_allclose(rotation, orientation, atol=1e-6)


def test_a_forearm_that_cannot_turn_loses_orientations_by_its_middle_roll() -> None:
    arm = gantry()
    wrist = find_wrist(arm)
    assert wrist is not None
    inside = np.array([[0.1, -0.2, 0.4]])
    (answer,) = query(arm, inside, mode='dextrous', settings=FtwsSettings())
    assert answer.verdict is Verdict.NON_MEMBER
    assert answer.joints == ('roll_1',) and answer.residual > 0.0
    quaternion = np.array(
        [float(x) for x in answer.reason.split('= [')[1].split(']')[0].split(',')]
    )
    orientation = Rotation.from_quat(quaternion).as_matrix()
    # However the others stand, the last roll's axis is where it was, and not where it has to be.
    for q in np.random.default_rng(2).uniform(-1.0, 1.0, (20, 9)):
        q[7] = answer.angles[0]
        has = fk(arm, q)[0] @ wrist.axis
        assert np.linalg.norm(has - orientation @ wrist.axis) > 1e-3
    far = np.array([[5.0, 0.0, 0.0]])
    (answer,) = query(arm, far, mode='dextrous', settings=FtwsSettings())
    assert answer.verdict is Verdict.NON_MEMBER and 'any orientation' in answer.reason


def test_directions_are_spread_over_the_whole_sphere() -> None:
    spread = directions()
    np.testing.assert_allclose(np.linalg.norm(spread, axis=1), 1.0)
    probes = np.random.default_rng(3).normal(size=(2000, 3))
    probes /= np.linalg.norm(probes, axis=1, keepdims=True)
    nearest = np.arccos(np.clip((probes @ spread.T).max(axis=1), -1.0, 1.0))
    assert nearest.max() < np.radians(11.0)
