"""States, plans and commands that come late, as on a busy machine: every promised goal is met."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.planning.executive import Executive
from ft_manip_ros.core.planning.plan import PlanStatus
from ft_manip_ros.core.sim import SimulatedArm
from ft_manip_ros.core.task_file import load_task

ARM = load_arm('paredis_table_3')
TASK = load_task('paredis_eq_11')
MS = 1_000_000


@dataclass(frozen=True)
class Delays:
    """Mean delays of states and commands, time to plan, share and mean length of stalls (ms)."""

    states: int = 0
    planning: int = 10
    commands: int = 0
    stalls: float = 0.0
    stall: int = 0


class LateStory:
    """The healthy arm sets out, one joint locks, and everything takes its time; ms by ms."""

    def __init__(self, delays, seed):
        self.delays, self.rng = delays, np.random.default_rng(seed)
        start = 0.25 * (ARM.upper - ARM.lower) * self.rng.uniform(-1.0, 1.0, ARM.n)
        self.now = 0
        self.arm = SimulatedArm(ARM, start=start)
        self.executive = Executive(ARM, clock=lambda: self.now * MS)
        self.joint = str(self.rng.choice(ARM.joint_names))
        self.underway, self.commands, self.decisions = [], [], []
        self.stalled_until = self.busy_until = 0
        self.tools = []

    def late(self, mean):
        return self.now + (int(self.rng.exponential(mean)) if mean else 0)

    def turn(self):
        """Let one millisecond pass."""
        self.now += 1
        self.arm_turn()
        if self.now >= self.busy_until and self.underway and self.underway[0][0] <= self.now:
            _, stamp, q, v = self.underway.pop(0)
            state = dict(zip(ARM.joint_names, q, strict=True))
            speeds = dict(zip(ARM.joint_names, v, strict=True))
            _, decision = self.executive.on_joint_state(stamp * MS, state, speeds)
            self.send(decision)
            return stamp, state
        return None, None

    def arm_turn(self):
        if self.now < self.stalled_until:
            return
        while self.commands and self.commands[0][0] <= self.now:
            _, decision = self.commands.pop(0)
            self.arm.advance(self.now * 1e-3)
            self.arm.follow(decision.plan.trajectory.path(), decision.stamp * 1e-9)
        if self.now % 10 == 0 or self.now == self.stalled_until:
            self.arm.advance(self.now * 1e-3)
            # What is late does not overtake what was sent before it.
            due = max(self.late(self.delays.states), self.underway[-1][0] if self.underway else 0)
            self.underway.append((due, self.now, *self.arm.measure()))
            self.tools.append((self.now, self.arm.position.copy()))
        if self.rng.random() < self.delays.stalls:
            self.stalled_until = self.late(self.delays.stall)

    def send(self, decision):
        if decision is None:
            return
        self.decisions.append(decision)
        self.busy_until = self.now + self.delays.planning
        due = self.busy_until + self.late(self.delays.commands) - self.now
        self.commands.append((max([due, *(c[0] for c in self.commands)]), decision))

    def tell(self):
        """Run until nothing remains, at most a minute; return the plan after the lock."""
        while not self.decisions:
            if self.turn()[0] is not None and self.now > 100 and self.executive.task is None:
                self.send(self.executive.on_task(TASK))
        last = max(o.arrival for o in self.decisions[0].plan.outcomes) * 1e3
        lock = self.now + int(self.rng.uniform(0.1, 0.8) * last)
        self.arm.lock(self.joint, lock * 1e-3)
        seen = 0
        while seen <= lock + 150:
            stamp, state = self.turn()
            seen = stamp or seen
        sigma = {self.joint: 1e-5}
        self.send(self.executive.on_fault_state(seen * MS, {self.joint: state[self.joint]}, sigma))
        while self.now < 60_000 and self.executive.remaining:
            self.turn()
        return next(decision.plan for decision in self.decisions if decision.degraded), lock


@pytest.mark.parametrize('seed', [2, 4, 9])
@pytest.mark.parametrize(
    'delays',
    [
        Delays(states=20, planning=30, commands=20, stalls=0.001, stall=50),
        Delays(planning=10, commands=300),
        Delays(states=50, planning=100, stalls=0.003, stall=300),
    ],
    ids=['busy', 'late commands', 'stalling arm'],
)
def test_every_promised_goal_is_met_however_late_all_comes(delays, seed):
    story = LateStory(delays, seed)
    plan, lock = story.tell()
    assert plan.status == PlanStatus.FINISHES
    assert story.executive.remaining == ()
    after = np.array([q for time, q in story.tools if time > lock])
    _, tools = fk(ARM, after)
    for outcome in plan.outcomes:
        # In truth, not only as measured.
        off = np.linalg.norm(tools - outcome.goal.position, axis=1).min()
        assert off < outcome.goal.position_tolerance + 1e-4, (outcome.goal.id, story.joint)


def states(executive, stamps):
    still = dict.fromkeys(ARM.joint_names, 0.3)
    decisions = [executive.on_joint_state(stamp * MS, still)[1] for stamp in stamps]
    return [decision for decision in decisions if decision is not None]


def test_states_that_have_waited_are_passed_over_while_newer_ones_come():
    now = 1000
    executive = Executive(ARM, clock=lambda: now * MS)
    states(executive, [500, 510])
    assert executive.on_task(TASK) is None
    assert executive.waiting
    decisions = states(executive, [600, 690, 780, 870, 910, 920])
    assert [decision.stamp for decision in decisions] == [910 * MS]
    assert not executive.waiting


def test_stamps_of_another_clock_do_not_keep_the_arm_waiting_for_ever():
    executive = Executive(ARM, clock=lambda: 10**18)
    states(executive, [500, 510])
    assert executive.on_task(TASK) is None
    assert len(states(executive, range(520, 1000, 10))) == 1


def test_a_state_that_no_other_follows_is_planned_from():
    executive = Executive(ARM, clock=lambda: 10**18)
    states(executive, [500])
    assert executive.on_task(TASK) is not None
