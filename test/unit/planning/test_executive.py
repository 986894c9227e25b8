"""The executive driven by a simulated arm: progress, failures, retries, stale and bad input."""

from __future__ import annotations

import numpy as np
import pytest

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import Goal, Task
from ft_manip_ros.core.planning.decision import ExecutiveSettings
from ft_manip_ros.core.planning.executive import Executive
from ft_manip_ros.core.planning.plan import Outcome, PlanStatus
from ft_manip_ros.core.planning.proof import prove
from ft_manip_ros.core.planning.settings import PlanSettings
from ft_manip_ros.core.sim import SimulatedArm
from ft_manip_ros.core.task_file import load_task

ARM = load_arm('paredis_table_3')
TASK = load_task('paredis_eq_11')
PERIOD = 0.01


class Story:
    """A simulated arm that follows what an executive decides, sample by sample."""

    def __init__(self, executive=None, *, deaf=False):
        self.executive = executive or Executive(ARM)
        self.arm = SimulatedArm(ARM, time=0.0)
        self.time = 0.0
        self.deaf = deaf
        self.broken = {}
        self.visited = []
        self.decisions = []
        self.tick()

    def obey(self, decision):
        if decision is None:
            return
        self.decisions.append(decision)
        if decision.plan.trajectory is not None and not self.deaf:
            self.arm.follow(decision.plan.trajectory.path(), decision.stamp * 1e-9)

    def tick(self):
        self.time += PERIOD
        self.arm.advance(self.time)
        position, velocity = self.arm.measure()
        names = ARM.joint_names
        state = {**dict(zip(names, position, strict=True)), **self.broken}
        visited, decision = self.executive.on_joint_state(
            self.stamp,
            {name: value for name, value in state.items() if value is not None},
            dict(zip(names, velocity, strict=True)),
        )
        self.visited += visited
        self.obey(decision)

    @property
    def stamp(self):
        return round(self.time * 1e9)

    def run(self, duration):
        for _ in range(round(duration / PERIOD)):
            self.tick()

    def lock(self, name):
        self.arm.lock(name, self.time)
        self.run(0.1)
        frozen = {**self.executive.frozen, name: float(self.arm.position[ARM.index(name)])}
        self.obey(self.executive.on_fault_state(self.stamp, frozen, {name: 1e-5}))


def test_healthy_task_is_done_in_order():
    story = Story()
    story.obey(story.executive.on_task(TASK))
    plan = story.decisions[0].plan
    assert not story.decisions[0].degraded
    story.run(plan.trajectory.duration + 0.5)
    assert [goal.index for goal in story.visited] == [0, 1, 2]
    assert all(goal.position_error < 1e-3 for goal in story.visited)
    assert story.executive.remaining == ()
    assert len(story.decisions) == 1


@pytest.mark.parametrize('joint', ARM.joint_names)
@pytest.mark.parametrize('when', [0.4, 2.5])
def test_any_joint_may_lock_on_the_way(joint, when):
    story = Story()
    story.obey(story.executive.on_task(TASK))
    story.run(when)
    story.lock(joint)
    decision = story.decisions[-1]
    assert decision.degraded
    assert decision.plan.status == PlanStatus.FINISHES
    # The motion starts from the measured state.
    k = decision.plan.trajectory
    healthy = [i for i, name in enumerate(ARM.joint_names) if name != joint]
    assert np.abs(k.positions[0] - story.arm.position)[healthy].max() < 1e-3
    story.run(k.duration + 0.5)
    assert sorted(goal.index for goal in story.visited) == [0, 1, 2]
    assert len(story.decisions) == 2


@pytest.mark.parametrize('reading', [None, np.nan, 1e184, 0.3])
def test_a_frozen_joint_needs_no_sensor(reading):
    story = Story()
    story.obey(story.executive.on_task(TASK))
    story.run(0.5)
    story.lock('joint_3')
    story.broken = {'joint_3': reading}
    # A second failure, so that the plan is made with the broken sensor.
    story.lock('joint_5')
    decision = story.decisions[-1]
    assert set(decision.plan.frozen) == {'joint_3', 'joint_5'}
    assert decision.plan.trajectory is not None
    promised = [outcome.index for outcome in decision.plan.outcomes if outcome.has_posture]
    assert promised
    story.run(decision.plan.trajectory.duration + 0.5)
    assert set(promised) <= {goal.index for goal in story.visited}
    assert story.decisions[-1] is decision


def test_a_cleared_joint_goes_on_from_where_it_is_measured():
    story = Story()
    story.obey(story.executive.on_task(TASK))
    story.run(0.5)
    story.lock('joint_3')
    story.broken = {'joint_3': None}
    story.run(0.1)
    # Unlike where it was frozen, nothing says where it stands now.
    assert story.executive.on_fault_state(story.stamp, {}, {}) is None
    with pytest.raises(InputError, match='joint_3'):
        story.tick()
    moved = float(story.arm.position[2]) + 0.05
    story.broken = {'joint_3': moved}
    story.tick()
    decision = story.decisions[-1]
    assert not decision.degraded
    assert decision.plan.trajectory.positions[0, 2] == moved


def test_the_sensor_of_a_healthy_joint_is_needed():
    story = Story()
    story.broken = {'joint_3': np.nan}
    with pytest.raises(InputError, match='joint_3'):
        story.tick()


def test_second_and_third_failures_and_a_joint_that_comes_back():
    story = Story()
    story.obey(story.executive.on_task(TASK))
    story.run(0.5)
    for count, joint in enumerate(('joint_5', 'joint_2', 'joint_4'), 1):
        story.lock(joint)
        plan = story.decisions[-1].plan
        assert len(plan.frozen) == count
        assert plan.status != PlanStatus.REFUSED
        story.run(0.3)
    assert story.decisions[-1].plan.status in (PlanStatus.HALTED, PlanStatus.PARTIAL)
    # Only an explicit clear brings joints back: the fault state then names fewer.
    for joint in ('joint_5', 'joint_2', 'joint_4'):
        story.arm.release(joint, story.time)
    story.run(0.1)
    assert story.executive.on_fault_state(story.stamp, {}, {}) is None
    story.tick()
    decision = story.decisions[-1]
    assert not decision.degraded
    assert 'cleared' in decision.cause
    story.run(decision.plan.trajectory.duration + 0.5)
    assert story.executive.remaining == ()


def test_the_same_fault_state_again_changes_nothing():
    story = Story()
    story.obey(story.executive.on_task(TASK))
    story.run(0.5)
    story.lock('joint_1')
    frozen = dict(story.executive.frozen)
    assert story.executive.on_fault_state(story.stamp, frozen, {}) is None


def test_runaway_joint_stops_everything():
    story = Story()
    story.obey(story.executive.on_task(TASK))
    story.run(1.0)
    decision = story.executive.on_fault_state(story.stamp, {}, {}, ('joint_3',))
    assert decision.plan.status == PlanStatus.HALTED
    assert 'joint_3 runs away' in decision.plan.reason
    story.obey(decision)
    story.run(1.0)
    assert np.abs(story.arm.velocity).max() < 1e-3


def test_no_goal_is_tried_again_from_readings_that_are_not_believed():
    story = Story(Executive(ARM, watching=ExecutiveSettings(retries=2)), deaf=True)
    story.obey(story.executive.on_task(TASK))
    assert story.executive.on_fault_state(story.stamp, {}, {}, (), ('joint_2',)) is None
    story.run(15.0)
    assert len(story.decisions) == 1
    # Believed again.
    assert story.executive.on_fault_state(story.stamp, {}, {}) is None
    story.run(1.0)
    assert len(story.decisions) == 2
    assert 'not met' in story.decisions[-1].cause


def test_missed_goals_are_tried_again_but_not_for_ever():
    story = Story(Executive(ARM, watching=ExecutiveSettings(retries=2)), deaf=True)
    story.obey(story.executive.on_task(TASK))
    story.run(30.0)
    assert len(story.decisions) == 1 + 2
    assert 'not met' in story.decisions[-1].cause
    assert story.executive.remaining == (0, 1, 2)


def test_nothing_is_planned_from_an_old_state():
    story = Story()
    story.obey(story.executive.on_task(TASK))
    story.run(0.5)
    late = story.stamp + 2_000_000_000
    assert story.executive.on_fault_state(late, {'joint_1': 0.1}, {}) is None
    story.time += 2.0
    story.tick()
    assert story.decisions[-1].degraded
    assert story.decisions[-1].stamp == story.stamp


def test_task_before_any_state_waits_for_one():
    executive = Executive(ARM)
    assert executive.on_task(TASK) is None
    _, decision = executive.on_joint_state(1, dict.fromkeys(ARM.joint_names, 0.0))
    assert decision.plan.status == PlanStatus.FINISHES


def test_late_and_foreign_samples_are_harmless():
    executive = Executive(ARM)
    state = {**dict.fromkeys(ARM.joint_names, 0.0), 'gripper': np.nan}
    assert executive.on_joint_state(100, state) == ([], None)
    moved = {**state, 'joint_1': 1.0}
    executive.on_joint_state(50, moved)
    decision = executive.on_task(TASK)
    assert decision.stamp == 100
    assert decision.plan.trajectory.positions[0, 0] == 0.0


def test_velocity_is_fitted_where_none_is_given():
    executive = Executive(ARM)
    for k in range(20):
        q = dict.fromkeys(ARM.joint_names, 0.0)
        q['joint_2'] = 0.3 * k * PERIOD
        executive.on_joint_state(round(k * PERIOD * 1e9), q)
    decision = executive.on_task(TASK)
    np.testing.assert_allclose(
        decision.plan.trajectory.velocities[0], [0.0, 0.3, 0.0, 0.0, 0.0], atol=1e-9
    )


@pytest.mark.parametrize(
    ('positions', 'words'),
    [
        ({'joint_1': 0.0}, 'joint_2, joint_3'),
        ({**dict.fromkeys(ARM.joint_names, 0.0), 'joint_4': np.nan}, 'joint_4: NaN'),
        (
            {**dict.fromkeys(ARM.joint_names, 0.0), 'joint_3': 1e95},
            r'joint_3: is 1e\+95; readings',
        ),
    ],
)
def test_bad_states_are_refused_and_nothing_changes(positions, words):
    executive = Executive(ARM)
    executive.on_joint_state(1, dict.fromkeys(ARM.joint_names, 0.0))
    with pytest.raises(InputError, match=words):
        executive.on_joint_state(2, positions)
    assert executive.on_task(TASK).stamp == 1


@pytest.mark.parametrize('speed', [1e4, 1e50, np.inf])
def test_a_speed_that_no_joint_has_is_taken_for_unknown(speed):
    executive = Executive(ARM)
    at_rest = dict.fromkeys(ARM.joint_names, 0.2)
    executive.on_joint_state(
        10**9, at_rest, {**dict.fromkeys(ARM.joint_names, 0.0), 'joint_3': speed}
    )
    assert executive.on_task(TASK).plan.status == PlanStatus.FINISHES


def test_a_jump_within_a_microsecond_is_no_speed():
    executive = Executive(ARM)
    executive.on_joint_state(10**9, dict.fromkeys(ARM.joint_names, 0.2))
    executive.on_joint_state(10**9 + 1000, dict.fromkeys(ARM.joint_names, 0.3))
    assert executive.on_task(TASK).plan.status == PlanStatus.FINISHES


def test_bad_faults_are_refused():
    executive = Executive(ARM)
    with pytest.raises(InputError, match='wrist'):
        executive.on_fault_state(1, {'wrist': 0.0}, {})
    with pytest.raises(InputError, match='finite'):
        executive.on_fault_state(1, {'joint_1': np.nan}, {})
    assert executive.frozen == {}


def test_proof_restates_the_plan_and_outdated_ones_are_dropped():
    story = Story()
    far = Task('far', (*TASK.goals, Goal([0.0, 0.0, 3.3], id='far')))
    story.obey(story.executive.on_task(far))
    story.lock('joint_4')
    decision = story.decisions[-1]
    assert decision.plan.outcomes[-1].outcome == Outcome.UNDECIDED
    proof = prove(ARM, decision.plan, PlanSettings())
    better = story.executive.on_proof(decision, proof)
    assert better.restated
    assert better.plan.outcomes[-1].outcome == Outcome.LOST
    assert better.plan.trajectory is decision.plan.trajectory
    assert story.executive.on_proof(decision, proof) is None
