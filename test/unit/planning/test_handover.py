"""While a plan among bodies is made the arm stops; the plan goes on from there, without a jump."""

from __future__ import annotations

import numpy as np
import pytest

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.goal import Task
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.executive import Executive
from ft_manip_ros.core.planning.link_capsules import capsule_model
from ft_manip_ros.core.planning.plan import PlanStatus
from ft_manip_ros.core.task_file import load_task

ARM = load_arm('paredis_table_3')
GOALS = load_task('paredis_eq_11').goals
SECOND = 1_000_000_000
STAMP = 7 * SECOND
Q = np.array([0.4, -0.6, 0.8, 0.3, 0.2])
V = np.array([0.5, -0.3, 0.0, 0.4, -0.2])
FROZEN = 'joint_3'


class Story:
    """A moving arm, a lock, and a clock that runs ``takes`` s ahead while the plan is made.

    The stop marks the beginning: whatever comes between it and the plan takes that long.
    """

    def __init__(self, takes, velocity=V, checked=True):
        self.takes, self.stops = takes, []
        self.now, self.calls = STAMP, 0
        bodies = capsule_model(ARM, 0.02, (), 0.005) if checked else None
        self.executive = Executive(
            ARM,
            checker=CollisionChecker(bodies) if bodies is not None else None,
            clock=self.clock,
            send_stop=self.on_stop,
        )
        state = dict(zip(ARM.joint_names, Q, strict=True))
        speeds = dict(zip(ARM.joint_names, velocity, strict=True))
        self.executive.on_joint_state(STAMP, state, speeds)
        assert self.executive.on_task(Task('eq_11', GOALS)) is not None
        self.first_stops, self.stops = self.stops, []
        self.now, self.calls = STAMP, 0
        self.decision = self.executive.on_fault_state(STAMP, {FROZEN: Q[2]}, {FROZEN: 1e-5})
        assert self.decision is not None
        self.plan = self.decision.plan

    def clock(self):
        self.calls += 1
        # Looked at when planning begins, and when it is over.
        return self.now if self.calls <= 1 else self.now + round(self.takes * SECOND)

    def on_stop(self, motion, stamp):
        self.stops.append((motion, stamp))


def rest_end(plan):
    """Time of the end of the first rest of a plan's trajectory."""
    moves = np.abs(plan.trajectory.velocities).max(axis=1) > 1e-9
    first_rest = int(np.argmax(~moves))
    return plan.trajectory.times[first_rest + int(np.argmax(moves[first_rest:])) - 1]


@pytest.mark.parametrize('takes', [0.0, 0.05, 0.4, 1.5])
def test_the_stop_is_the_beginning_of_the_plan_which_rests_until_it_is_there(takes):
    story = Story(takes)
    assert story.plan.status == PlanStatus.FINISHES
    ((stop, stamp),) = story.stops
    assert stamp == STAMP == story.decision.stamp
    assert np.abs(stop.velocities[-1]).max() == 0.0
    path, whole = stop.path(), story.plan.trajectory.path()
    # Until the controller has the plan, a little after it was made, both say the same.
    for time in np.linspace(0.0, takes + 0.019, 50):
        for there, here in zip(path.sample(time), whole.sample(time), strict=True):
            assert np.abs(there - here).max() < 1e-9
    assert rest_end(story.plan) >= takes + 0.02 - 1e-6
    assert (story.plan.trajectory.positions[:, 2] == Q[2]).all()


def test_the_rest_is_no_longer_than_planning_took():
    quick, slow = Story(0.0), Story(0.8)
    assert quick.plan.pause == 0.0
    assert 0.0 < slow.plan.pause < 0.82
    assert slow.plan.trajectory.duration - quick.plan.trajectory.duration == pytest.approx(
        slow.plan.pause, abs=1e-8
    )
    for early, late in zip(quick.plan.outcomes, slow.plan.outcomes, strict=True):
        assert late.arrival - early.arrival == pytest.approx(slow.plan.pause, abs=1e-8)
        assert (late.posture == early.posture).all()


def test_an_arm_at_rest_is_sent_no_stop_but_is_given_the_time():
    story = Story(0.5, velocity=np.zeros(ARM.n))
    assert story.stops == []
    assert rest_end(story.plan) >= 0.52 - 1e-6


def test_without_bodies_the_arm_flows_on():
    story = Story(0.01, checked=False)
    assert story.stops == []
    assert story.plan.pause == 0.0
    assert np.abs(story.plan.trajectory.velocities[1]).max() > 0.0
