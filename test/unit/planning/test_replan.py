"""Plans for known arms: what is reached, what is lost and why, policies, relaxations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.joint import Joint
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.planning import replan
from ft_manip_ros.core.planning.plan import Outcome, PlanStatus
from ft_manip_ros.core.planning.proof import needs_proof, prove
from ft_manip_ros.core.planning.replan import plan_task
from ft_manip_ros.core.planning.settings import PlanSettings, Policy, Relaxation
from ft_manip_ros.core.task_file import load_task

TABLE_3 = load_arm('paredis_table_3')
SETTINGS = PlanSettings()


def plan(chain, goals, *, frozen=None, sigma=None, start=None, velocity=None, settings=SETTINGS):
    return plan_task(
        chain,
        list(enumerate(goals)),
        frozen=frozen or {},
        sigma=sigma or {},
        start=np.zeros(chain.n) if start is None else start,
        start_velocity=np.zeros(chain.n) if velocity is None else velocity,
        settings=settings,
    )


@pytest.mark.parametrize('joint', TABLE_3.joint_names)
@pytest.mark.parametrize('angle', [-2.5, -1.0, 0.3, 2.0])
def test_task_of_equation_11_survives_any_joint(joint, angle):
    # The paper's claim: these points are fault tolerant on Table 3.
    goals = load_task('paredis_eq_11').goals
    found = plan(TABLE_3, goals, frozen={joint: angle})
    assert found.status == PlanStatus.FINISHES
    for outcome in found.outcomes:
        q, _ = found.trajectory.path().sample(outcome.arrival)
        _, tool = fk(TABLE_3, q)
        assert np.linalg.norm(tool - outcome.goal.position) < 1e-6
        assert outcome.position_error < 1e-6
        assert q[TABLE_3.index(joint)] == angle
    arrivals = [outcome.arrival for outcome in found.outcomes]
    assert arrivals == sorted(arrivals)


def planar(lengths, limit=np.pi):
    joints = tuple(Joint(f'j{i}', -limit, limit) for i in range(len(lengths)))
    translations = np.zeros((len(lengths) + 1, 3))
    translations[1:, 0] = lengths
    return SerialChain(
        'planar', joints, np.tile(np.eye(3), (len(lengths) + 1, 1, 1)), translations
    )


def test_elbow_frozen_leaves_one_circle():
    # Two links of 1 m with the elbow at 90 degrees: the tool is sqrt(2) from the base, always.
    arm = planar([1.0, 1.0])
    on_circle = Goal(np.sqrt(2.0) * np.array([np.cos(2.0), np.sin(2.0), 0.0]))
    inside, outside = Goal([1.2, 0.0, 0.0]), Goal([0.0, 2.5, 0.0])
    start = np.array([0.0, np.pi / 2.0])
    found = plan(arm, [on_circle, inside, outside], frozen={'j1': np.pi / 2.0}, start=start)
    assert [o.outcome for o in found.outcomes] == [
        Outcome.REACHABLE,
        Outcome.LOST,
        Outcome.LOST,
    ]
    assert found.status == PlanStatus.PARTIAL
    assert found.outcomes[1].margin == pytest.approx(np.sqrt(2.0) - 1.2, abs=1e-9)
    assert found.outcomes[2].margin == pytest.approx(2.5 - np.sqrt(2.0), abs=1e-9)


def test_limits_lose_a_point_and_the_proof_says_by_how_much():
    # Both joints within 45 degrees: the tool cannot come nearer than with the elbow at 45.
    arm = planar([1.0, 1.0, 1.0], limit=np.pi / 4.0)
    found = plan(arm, [Goal([1.5, 0.0, 0.0])], frozen={'j0': 0.0})
    assert found.outcomes[0].outcome == Outcome.UNDECIDED
    proved = prove(arm, found, SETTINGS)
    assert not proved.found
    lost = proved.plan.outcomes[0]
    assert lost.outcome == Outcome.LOST
    qs = np.stack(np.meshgrid([0.0], *[np.linspace(-np.pi / 4, np.pi / 4, 301)] * 2), -1)
    _, tools = fk(arm, qs.reshape(-1, 3))
    nearest = np.linalg.norm(tools - [1.5, 0.0, 0.0], axis=1).min()
    assert 1e-3 < lost.margin <= nearest
    assert lost.margin > 0.1 * nearest
    assert found.outcomes[0].position_error == pytest.approx(nearest, abs=1e-3)
    assert not needs_proof(proved.plan)
    assert proved.plan.trajectory is found.trajectory


def test_point_off_the_plane_is_proved_lost():
    arm = planar([1.0, 1.0, 1.0])
    found = plan(arm, [Goal([1.0, 0.0, 0.2])], frozen={'j0': 0.0})
    lost = prove(arm, found, SETTINGS).plan.outcomes[0]
    assert lost.outcome == Outcome.LOST
    assert lost.margin == pytest.approx(0.2)


def creeping(speed):
    joints = tuple(Joint(f'j{i}', -3.0, 3.0, velocity=speed, acceleration=speed) for i in (0, 1))
    return replace(planar([1.0, 1.0]), joints=joints)


def test_a_motion_of_hours_is_planned_and_one_of_centuries_refused():
    goals, velocity = [Goal([0.0, 1.5, 0.0])], np.array([1.0, -0.5])
    arm = creeping(1e-5)
    found = plan(arm, goals, start=np.array([0.1, 0.2]), velocity=0.5e-5 * velocity)
    assert found.status == PlanStatus.FINISHES
    assert 7600.0 < found.outcomes[0].arrival < found.trajectory.duration < 1e6
    at, _ = found.trajectory.path().sample(found.outcomes[0].arrival)
    np.testing.assert_allclose(fk(arm, at)[1], [0.0, 1.5, 0.0], atol=1e-6)
    found = plan(creeping(1e-10), goals, start=np.array([0.1, 0.2]))
    assert found.status == PlanStatus.REFUSED
    assert 'a message can say' in found.reason
    # What is sent instead is the stop.
    assert np.ptp(found.trajectory.positions, axis=0).max() < 1e-6


def test_too_small_a_budget_leaves_it_undecided():
    found = plan(TABLE_3, [Goal([0.0, 0.0, 3.3])], frozen={'joint_4': 0.0})
    small = prove(TABLE_3, found, PlanSettings(proof_boxes=1)).plan
    assert small.outcomes[0].outcome == Outcome.UNDECIDED
    assert prove(TABLE_3, found, SETTINGS).plan.outcomes[0].outcome == Outcome.LOST


def test_uncertain_frozen_position_is_not_proved_lost():
    # The elbow may stand anywhere within 3 sigma, and somewhere in there the goal is reached.
    arm = planar([1.0, 1.0])
    frozen = {'j1': np.pi / 2.0}
    goal = Goal([np.sqrt(2.0) + 0.01, 0.0, 0.0])
    sure = plan(arm, [goal], frozen=frozen, sigma={'j1': 1e-6})
    assert sure.outcomes[0].outcome == Outcome.LOST
    unsure = plan(arm, [goal], frozen=frozen, sigma={'j1': 0.01})
    assert prove(arm, unsure, SETTINGS).plan.outcomes[0].outcome == Outcome.UNDECIDED


def test_relaxations_are_named_and_used_only_where_accepted():
    # A planar arm keeps its tool's z axis: roll about it is all that can be freed.
    arm = planar([1.0, 1.0])
    c, s = np.cos(1.0), np.sin(1.0)
    flat = Goal([1.0, 1.0, 0.0], np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]))
    tipped = Goal([1.0, 1.0, 0.0], np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]))
    reported = plan(arm, [flat, tipped])
    assert [o.outcome for o in reported.outcomes] == [Outcome.RELAXED, Outcome.RELAXED]
    assert [o.relaxation for o in reported.outcomes] == ['free roll', 'orientation dropped']
    assert reported.status == PlanStatus.HALTED
    accepting = PlanSettings(accepted=frozenset({Relaxation.FREE_ROLL}))
    used = plan(arm, [flat, tipped], settings=accepting)
    assert [o.has_posture for o in used.outcomes] == [True, False]
    assert used.status == PlanStatus.PARTIAL
    assert used.outcomes[0].orientation_error < 1e-6


@pytest.mark.parametrize('policy', list(Policy))
def test_policies(policy):
    goals = [*load_task('paredis_eq_11').goals, Goal([9.0, 0.0, 0.0])]
    velocity = np.array([0.5, -0.3, 0.0, 0.2, 0.1])
    found = plan(
        TABLE_3,
        goals,
        frozen={'joint_3': 0.4},
        velocity=velocity,
        settings=PlanSettings(policy=policy),
    )
    visited = [outcome.has_posture for outcome in found.outcomes]
    if policy == Policy.FINISH_REACHABLE:
        assert visited == [True, True, True, False]
        assert found.status == PlanStatus.PARTIAL
        return
    assert visited == [False] * 4
    assert found.status == PlanStatus.HALTED
    # The goals are judged all the same, and the stop is a motion of its own.
    assert found.outcomes[0].outcome == Outcome.REACHABLE
    np.testing.assert_allclose(found.trajectory.velocities[0], velocity * [1, 1, 0, 1, 1])
    assert found.trajectory.duration < 1.0


def test_policies_bind_only_after_a_failure():
    goals = load_task('paredis_eq_11').goals
    found = plan(TABLE_3, goals, settings=PlanSettings(policy=Policy.HALT))
    assert found.status == PlanStatus.FINISHES


def test_no_goals_and_no_healthy_joints():
    assert plan(TABLE_3, [], frozen={'joint_1': 0.0}).status == PlanStatus.FINISHES
    everything = dict.fromkeys(TABLE_3.joint_names, 0.2)
    _, here = fk(TABLE_3, np.full(5, 0.2))
    found = plan(TABLE_3, [Goal(here), Goal(here + 0.1)], frozen=everything)
    assert [o.outcome for o in found.outcomes] == [Outcome.REACHABLE, Outcome.LOST]
    assert np.all(found.trajectory.positions == 0.2)


def test_uncertainty_of_the_frozen_joint_reaches_the_tool():
    arm = planar([1.0, 1.0])
    found = plan(arm, [Goal([0.0, 2.0, 0.0])], frozen={'j0': np.pi / 2.0}, sigma={'j0': 1e-3})
    # The tool is 2 m from the first axis.
    assert found.outcomes[0].uncertainty == pytest.approx(2e-3, rel=1e-6)
    assert 'known to' in found.outcomes[0].reason


@pytest.mark.parametrize('names', [('joint_2',), ('joint_1', 'joint_4')])
def test_uncertainty_at_the_tool_is_that_of_arms_locked_elsewhere(names):
    # Monte Carlo: the arm drives to the planned posture, but its locked joints stand elsewhere.
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.5, 1.5, TABLE_3.n)
    frozen = {name: q[TABLE_3.index(name)] for name in names}
    sigma = {name: 2e-3 * (k + 1) for k, name in enumerate(names)}
    found = plan(TABLE_3, [Goal(fk(TABLE_3, q)[1])], frozen=frozen, sigma=sigma)
    outcome = found.outcomes[0]
    drawn = np.tile(outcome.posture, (20000, 1))
    for name, value in sigma.items():
        drawn[:, TABLE_3.index(name)] += value * rng.normal(size=len(drawn))
    off = np.linalg.norm(fk(TABLE_3, drawn)[1] - fk(TABLE_3, outcome.posture)[1], axis=1)
    assert outcome.uncertainty == pytest.approx(np.sqrt(np.mean(off**2)), rel=0.03)


def test_a_joint_read_a_hair_beyond_its_limit_starts_on_it():
    goals = load_task('paredis_eq_11').goals
    limit = TABLE_3.lower[1]
    start = np.array([0.0, limit - 4e-5, 0.3, -0.2, 0.5])
    creep = np.array([0.0, -2e-3, 0.0, 0.0, 0.0])
    found = plan(TABLE_3, goals, frozen={'joint_3': 0.3}, start=start, velocity=creep)
    assert found.status == PlanStatus.FINISHES
    assert found.trajectory.positions[0, 1] == limit
    assert found.trajectory.positions[:, 1].min() == limit
    # A joint that stands well outside is taken as it stands, and brought back.
    start[1] = limit - 0.05
    found = plan(TABLE_3, goals, frozen={'joint_3': 0.3}, start=start)
    assert found.status == PlanStatus.FINISHES
    assert found.trajectory.positions[0, 1] == start[1]
    assert np.all(np.diff(found.trajectory.positions[:6, 1]) >= 0.0)


def test_postures_at_rest_stay_off_the_limits():
    for angle in np.linspace(-2.5, 2.5, 7):
        found = plan(TABLE_3, load_task('paredis_eq_11').goals, frozen={'joint_4': angle})
        for outcome in found.outcomes:
            room = np.minimum(outcome.posture - TABLE_3.lower, TABLE_3.upper - outcome.posture)
            assert np.delete(room, 3).min() > 0.9e-3


def test_operating_limits_bind_only_before_a_failure():
    joints = (
        Joint('j0', -3.0, 3.0, operating_lower=-0.5, operating_upper=0.5),
        Joint('j1', -3.0, 3.0),
    )
    arm = planar([1.0, 1.0])
    arm = SerialChain('narrow', joints, arm.rotations, arm.translations)
    goal = Goal([-1.5, 1.0, 0.0])
    assert plan(arm, [goal]).outcomes[0].outcome == Outcome.UNDECIDED
    assert prove(arm, plan(arm, [goal]), SETTINGS).plan.outcomes[0].outcome == Outcome.LOST
    free = SerialChain(
        'free',
        (*joints, Joint('j2')),
        np.tile(np.eye(3), (4, 1, 1)),
        np.vstack([arm.translations, np.zeros(3)]),
    )
    assert plan(free, [goal], frozen={'j2': 0.0}).outcomes[0].outcome == Outcome.REACHABLE


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'frozen': {'wrist': 0.0}}, 'joint_1, joint_2'),
        ({'frozen': {'joint_1': np.nan}}, 'finite'),
        ({'sigma': {'joint_1': -1.0}}, '>= 0'),
        ({'start': np.zeros(4)}, r'needs \(5,\)'),
        ({'start': np.full(5, np.nan)}, 'NaN'),
        ({'velocity': np.full(5, np.inf)}, 'infinity'),
    ],
)
def test_malformed_input_is_named(change, words):
    with pytest.raises(InputError, match=words):
        plan(TABLE_3, load_task('paredis_eq_11').goals, **change)


@pytest.mark.parametrize('stop_is_safe', [True, False])
def test_a_motion_that_fails_the_gate_is_replaced_by_a_stop(monkeypatch, stop_is_safe):
    # The controller still follows the old motion, which commands the joint that failed.
    moving = np.array([0.0, 0.4, 0.0, 0.0, -0.3])

    def gate(chain, trajectory, limits, **state):
        long = trajectory.times[-1] > 1.0
        return ('too long for this test',) if long or not stop_is_safe else ()

    monkeypatch.setattr(replan, 'check_trajectory', gate)
    goals = load_task('paredis_eq_11').goals
    found = plan(TABLE_3, goals, frozen={'joint_3': 0.2}, velocity=moving)
    assert found.status == PlanStatus.REFUSED
    assert 'too long for this test' in found.reason
    assert not any(outcome.has_posture for outcome in found.outcomes)
    if stop_is_safe:
        np.testing.assert_allclose(found.trajectory.velocities[0], moving)
        assert not found.trajectory.velocities[-1].any()
        assert 'stops instead' in found.reason
    else:
        assert found.trajectory is None
        assert 'nothing is sent' in found.reason
