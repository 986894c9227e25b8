"""Mimic joints on the way: against Pinocchio's own, IK, RODs, proofs, plans, refusals."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.ik import solve_ik
from ft_manip_ros.core.kinematics import fk, jacobian
from ft_manip_ros.core.pinocchio_model import model_from_chain
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.link_capsules import capsule_model
from ft_manip_ros.core.planning.obstacles import Obstacle
from ft_manip_ros.core.planning.plan import Outcome, PlanStatus
from ft_manip_ros.core.planning.proof import prove
from ft_manip_ros.core.planning.replan import plan_task
from ft_manip_ros.core.planning.settings import PlanSettings
from ft_manip_ros.core.planning.urdf_bodies import urdf_model
from ft_manip_ros.core.urdf import chain_from_urdf
from ft_manip_ros.core.urdf_writer import chain_to_urdf
from support.chains import coupled_chain, random_posture

# A scissor-like arm: `elbow` and the slide `reach` follow others, `wrist` follows one off the way.
ARM = """<robot name="linkage">
  <link name="base"/><link name="motor"/><link name="l1"/>
  <link name="l2"><collision><origin xyz="0 0 0.1"/><geometry><sphere radius="0.05"/></geometry>
    </collision></link>
  <link name="l3"/><link name="l4"/>
  <link name="hand"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
  <joint name="drive" type="revolute">
    <parent link="base"/><child link="motor"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="2"/>
  </joint>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="l1"/><origin xyz="0 0 0.3" rpy="0 0.2 0"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2.5" effort="1" velocity="1"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="l1"/><child link="l2"/><origin xyz="0.4 0 0.1" rpy="1 0.2 0"/>
    <axis xyz="0 1 0"/><limit lower="-0.9" upper="2" effort="1" velocity="0.25"/>
    <mimic joint="shoulder" multiplier="-0.5" offset="0.2"/>
  </joint>
  <joint name="reach" type="prismatic">
    <parent link="l2"/><child link="l3"/><origin xyz="0.1 0 0.3"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
    <mimic joint="elbow" multiplier="0.2" offset="0.1"/>
  </joint>
  <joint name="twist" type="revolute">
    <parent link="l3"/><child link="l4"/><origin xyz="0.2 0.1 0.2"/><axis xyz="0.6 0 0.8"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/>
  </joint>
  <joint name="wrist" type="revolute">
    <parent link="l4"/><child link="hand"/><origin xyz="0.2 0 0.1"/><axis xyz="1 0 0"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/>
    <mimic joint="drive" multiplier="2"/>
  </joint>
</robot>
"""


def by_pinocchio(chain: SerialChain, q: np.ndarray, urdf: str, tip: str):
    """Tool frame and Jacobian from the URDF with free joints, mapped by hand; q by name."""
    model = pinocchio.buildModelFromXML(urdf)
    data = model.createData()
    shoulder, twist, drive = (q[chain.index(name)] for name in ('shoulder', 'twist', 'drive'))
    elbow = -0.5 * shoulder + 0.2
    at = {
        'shoulder': shoulder, 'elbow': elbow, 'reach': 0.2 * elbow + 0.1, 'twist': twist,
        'wrist': 2.0 * drive, 'drive': drive,
    }  # fmt: skip
    moves = {
        'shoulder': {'shoulder': 1.0, 'elbow': -0.5, 'reach': -0.1},
        'twist': {'twist': 1.0},
        'drive': {'wrist': 2.0},
    }
    whole = np.zeros(model.nq)
    for name, value in at.items():
        whole[model.joints[model.getJointId(name)].idx_q] = value
    frame = model.getFrameId(tip)
    columns = pinocchio.computeFrameJacobian(
        model, data, whole, frame, pinocchio.LOCAL_WORLD_ALIGNED
    )
    mapped = np.zeros((6, chain.n))
    for leader, parts in moves.items():
        for name, ratio in parts.items():
            column = columns[:, model.joints[model.getJointId(name)].idx_v]
            mapped[:, chain.index(leader)] += ratio * column
    return data.oMf[frame], mapped


def test_an_arm_read_from_its_urdf():
    chain = chain_from_urdf(ARM, tip='hand')
    assert chain.joint_names == ('shoulder', 'twist', 'drive')
    assert [axis.name for axis in chain.axes] == ['shoulder', 'elbow', 'reach', 'twist', 'wrist']
    shoulder, _, drive = chain.joints
    # The elbow's -0.9 is met at 2.2, its 0.25 rad/s at twice that; the slide is never in the way.
    assert (shoulder.lower, shoulder.upper, shoulder.velocity) == (-2.0, pytest.approx(2.2), 0.5)
    assert (drive.lower, drive.upper, drive.velocity) == (-1.0, 1.0, 0.5)
    rng = np.random.default_rng(1)
    for _ in range(20):
        q = random_posture(chain, rng)
        expected, columns = by_pinocchio(chain, q, ARM, 'hand')
        rotation, position = fk(chain, q)
        assert np.abs(rotation - expected.rotation).max() < 1e-14
        assert np.abs(position - expected.translation).max() < 1e-14
        assert np.abs(jacobian(chain, q) - columns).max() < 1e-14


def test_pinocchios_own_mimic_joints_agree():
    chain = chain_from_urdf(ARM, tip='l4')
    text = ARM.replace('joint="elbow" multiplier="0.2" offset="0.1"',
                       'joint="shoulder" multiplier="-0.1" offset="0.14"')  # fmt: skip
    model = pinocchio.buildModelFromXML(text, True)
    data = model.createData()
    frame = model.getFrameId('l4')
    places = [model.joints[model.getJointId(name)].idx_q for name in chain.joint_names]
    for q in np.random.default_rng(2).uniform(chain.lower, chain.upper, (20, chain.n)):
        whole = np.zeros(model.nq)
        whole[places] = q
        columns = pinocchio.computeFrameJacobian(
            model, data, whole, frame, pinocchio.LOCAL_WORLD_ALIGNED
        )
        assert np.abs(fk(chain, q)[1] - data.oMf[frame].translation).max() < 1e-14
        assert np.abs(jacobian(chain, q) - columns[:, places]).max() < 1e-14


def test_random_arms_agree_with_pinocchio_whose_axes_are_set_one_by_one():
    rng = np.random.default_rng(3)
    for _ in range(50):
        chain = coupled_chain(rng, 4, 3)
        model = model_from_chain(chain)
        data = model.createData()
        q = random_posture(chain, rng)
        moved = np.array([axis.ratio * q[axis.joint] for axis in chain.driven])
        columns = pinocchio.computeFrameJacobian(
            model, data, moved, model.getFrameId('tool'), pinocchio.LOCAL_WORLD_ALIGNED
        )
        mapped = np.zeros((6, 4))
        for k, axis in enumerate(chain.driven):
            mapped[:, axis.joint] += axis.ratio * columns[:, k]
        assert np.abs(jacobian(chain, q) - mapped).max() < 1e-12
        assert np.abs(fk(chain, q)[1] - data.oMf[model.getFrameId('tool')].translation).max() < (
            1e-12
        )


def test_a_locked_leader_takes_its_followers_with_it():
    rng = np.random.default_rng(4)
    for _ in range(20):
        chain = coupled_chain(rng, 4, 3)
        q = random_posture(chain, rng)
        locked = chain.joint_names[1]
        rod = chain.freeze({locked: q[1]})
        rest = np.delete(q, 1)
        assert all(axis.name.split('_of_')[-1] != locked for axis in rod.axes)
        assert np.abs(fk(rod, rest)[1] - fk(chain, q)[1]).max() < 1e-12
        assert np.abs(jacobian(rod, rest) - np.delete(jacobian(chain, q), 1, axis=1)).max() < 1e-12


def test_written_and_read_again_it_is_the_same_arm():
    chain = chain_from_urdf(ARM, tip='hand')
    again = chain_from_urdf(chain_to_urdf(chain), tip='tool')
    assert again.joint_names == chain.joint_names
    for a, b in zip(again.joints, chain.joints, strict=True):
        assert (a.lower, a.upper) == pytest.approx((b.lower, b.upper), abs=1e-12)
        assert (a.velocity, a.acceleration) == pytest.approx((b.velocity, b.acceleration))
    for q in np.random.default_rng(5).uniform(chain.lower, chain.upper, (10, chain.n)):
        assert np.abs(jacobian(again, q) - jacobian(chain, q)).max() < 1e-12


def test_a_leader_wraps_only_where_its_followers_come_round_with_it():
    turning = ARM.replace('name="drive" type="revolute"', 'name="drive" type="continuous"')
    turning = turning.replace('name="wrist" type="revolute"', 'name="wrist" type="continuous"')
    for multiplier, wraps in (('2', True), ('-1', True), ('0.5', False)):
        text = turning.replace('multiplier="2"', f'multiplier="{multiplier}"')
        chain = chain_from_urdf(text, tip='hand')
        assert bool(chain.arrays.wraps[chain.index('drive')]) is wraps


@pytest.mark.parametrize('kind', ['position', 'axis', 'pose'])
def test_inverse_kinematics_reaches_what_can_be_reached(kind):
    rng = np.random.default_rng(6)
    chains = [coupled_chain(rng, 5, 3) for _ in range(10)]
    solved = 0
    for chain in chains:
        for _ in range(10):
            q = random_posture(chain, rng)
            rotation, position = fk(chain, q)
            goal = Goal(position)
            if kind != 'position':
                goal = Goal(position, rotation, free_axis=kind == 'axis')
            result = solve_ik(chain, goal)
            assert np.all(result.q >= chain.lower) and np.all(result.q <= chain.upper)
            missed = np.linalg.norm(fk(chain, result.q)[1] - position)
            assert result.converged == (missed <= 1e-6 and result.orientation_error <= 1e-6)
            solved += result.converged
    # A pose with five joints has isolated answers, and narrow basins where ratios are large.
    assert solved >= (100 if kind == 'position' else 90)


def test_what_is_out_of_reach_ends_in_a_local_minimum():
    rng = np.random.default_rng(7)
    for _ in range(10):
        chain = coupled_chain(rng, 4, 2)
        goal = Goal(10.0 * rng.normal(size=3))
        result = solve_ik(chain, goal)
        assert not result.converged
        pull = jacobian(chain, result.q)[:3].T @ (goal.position - fk(chain, result.q)[1])
        # At a minimum only a limit stands against the pull.
        low = (result.q <= chain.lower) & (pull < 0.0)
        high = (result.q >= chain.upper) & (pull > 0.0)
        assert np.abs(pull[~(low | high)]).max(initial=0.0) < 1e-4


def test_a_plan_holds_the_locked_leader_and_meets_the_goals():
    chain = chain_from_urdf(ARM, tip='hand')
    rng = np.random.default_rng(8)
    start = np.array([0.3, 0.5, 0.2])
    goals = []
    for q in rng.uniform(chain.lower, chain.upper, (3, 3)):
        q[0] = start[0]
        goals.append(Goal(fk(chain, q)[1]))
    plan = plan_task(
        chain,
        list(enumerate(goals)),
        frozen={'shoulder': 0.3},
        sigma={'shoulder': 0.001},
        start=start,
        start_velocity=np.zeros(3),
        settings=PlanSettings(),
    )
    assert plan.status == PlanStatus.FINISHES
    path = plan.trajectory.path()
    # Elbow and slide are blurred with it.
    for outcome, goal in zip(plan.outcomes, goals, strict=True):
        q, _ = path.sample(outcome.arrival)
        assert q[0] == 0.3
        assert np.linalg.norm(fk(chain, q)[1] - goal.position) < 1e-5
        moved = np.linalg.norm(jacobian(chain, q)[:3, 0]) * 0.001
        assert outcome.uncertainty == pytest.approx(moved)


def test_lost_is_proved_for_the_arm_whose_axes_are_free():
    chain = chain_from_urdf(ARM, tip='hand')
    rng = np.random.default_rng(9)
    lost = 0
    for _ in range(10):
        goal = Goal(fk(chain, random_posture(chain, rng))[1] + rng.normal(size=3) * 0.3)
        plan = plan_task(
            chain,
            [(0, goal)],
            frozen={'twist': 0.4},
            sigma={},
            start=np.array([0.0, 0.4, 0.0]),
            start_velocity=np.zeros(3),
            settings=PlanSettings(proof_boxes=5000),
        )
        outcome = prove(chain, plan, PlanSettings(proof_boxes=5000)).plan.outcomes[0]
        if outcome.outcome != Outcome.LOST:
            continue
        lost += 1
        qs = rng.uniform(chain.lower, chain.upper, (20000, 3))
        qs[:, 1] = 0.4
        nearest = np.linalg.norm(fk(chain, qs)[1] - goal.position, axis=1).min()
        assert outcome.margin <= nearest
    assert lost >= 3


@pytest.mark.parametrize('bodies', ['capsules', 'urdf'])
def test_no_move_of_coupled_joints_passes_a_ball_unseen(bodies):
    chain = chain_from_urdf(ARM, tip='hand')
    rng = np.random.default_rng(10)
    ball = Obstacle('ball', 'sphere', (0.05,), fk(chain, np.array([0.5, 0.0, 0.0]))[1], np.eye(3))

    def judge(padding: float) -> CollisionChecker:
        if bodies == 'urdf':
            return CollisionChecker(urdf_model(chain, ARM, None, [ball], padding=padding))
        return CollisionChecker(capsule_model(chain, 0.03, [ball], padding))

    careful, exact = judge(0.005), judge(1e-9)
    # The hand's body is where the kinematics have the tool.
    model = exact.bodies.model
    data = model.createData()
    q = random_posture(chain, rng)
    pinocchio.framesForwardKinematics(model, data, exact.bodies.configuration(q))
    frame = model.getFrameId('hand' if bodies == 'urdf' else 'tool')
    assert np.abs(data.oMf[frame].translation - fk(chain, q)[1]).max() < 1e-12
    seen = {True: 0, False: 0}
    for _ in range(40):
        a, b = rng.uniform(chain.lower, chain.upper, (2, 3))
        dense = any(exact.touches(a + s * (b - a)) for s in np.linspace(0.0, 1.0, 300))
        found = careful.move_touches(a, b)
        seen[found] += 1
        if dense:
            assert found
    assert min(seen.values()) >= 3


def test_verdicts_are_refused_by_name():
    chain = chain_from_urdf(ARM, tip='hand')
    with pytest.raises(InputError, match=r"joint 'elbow': mimics 'shoulder'"):
        query(chain, np.array([[0.5, 0.0, 0.5]]))


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ('mimic joint="drive"', 'mimic joint="drove"', r"'wrist': mimic: names 'drove'; joints"),
        ('mimic joint="shoulder"', 'mimic joint="reach"', r'circle: elbow -> reach -> elbow'),
        ('offset="0.2"', 'offset="9"', r"'elbow': has no range left: it mimics 'shoulder'"),
    ],
)
def test_what_cannot_be_mimicked_is_named(old, new, message):
    assert old in ARM
    with pytest.raises(InputError, match=message):
        chain_from_urdf(ARM.replace(old, new), tip='hand')


def test_what_follows_a_joint_that_cannot_move_stands_still():
    text = ARM.replace('lower="-2" upper="2.5"', 'lower="0.4" upper="0.4"')
    fixed, whole = chain_from_urdf(text, tip='hand'), chain_from_urdf(ARM, tip='hand')
    assert fixed.joint_names == ('twist', 'drive')
    assert np.abs(fk(fixed, [0.3, 0.1])[1] - fk(whole, [0.4, 0.3, 0.1])[1]).max() < 1e-14
