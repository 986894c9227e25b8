"""Failure upon failure among bodies, with clearing: every motion that leaves is safe."""

from __future__ import annotations

from collections import Counter

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ft_manip_ros.core.goal import Goal, Task
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.executive import Executive
from ft_manip_ros.core.planning.link_capsules import capsule_model
from ft_manip_ros.core.planning.obstacles import Obstacle
from ft_manip_ros.core.planning.settings import PlanSettings
from support.plain_collision import PlainChecker
from support.planned_motion import assert_safe, random_arm, random_goals

SECOND = 1_000_000_000
PLANNING = PlanSettings(attempts=6, dwell=0.05, detour_checks=150)


class Recovery:
    """A random arm that does what its executive decides, while joints fail and are cleared.

    ``seen`` counts what came about; every motion is judged as it comes.
    """

    def __init__(self, seed, bodies):
        self.rng = np.random.default_rng(seed)
        self.chain = random_arm(self.rng, int(self.rng.integers(3, 7)))
        self.seen = Counter(followers=bool(self.chain.driven))
        self.model = self._bodies() if bodies else None
        self.now, self.planning_takes = SECOND, 0.0
        self.path, self.begun = None, 0
        self.stood = self._free_posture()
        self.locked = {}
        self.stops = []
        self.executive = Executive(
            self.chain,
            PLANNING,
            checker=CollisionChecker(self.model) if bodies else None,
            clock=self.clock,
            send_stop=self.on_stop,
        )
        self.measure()
        goals = random_goals(self.rng, self.chain, int(self.rng.integers(1, 4)))
        if self.rng.random() < 0.6:
            goals = [Goal(fk(self.chain, self._free_posture())[1]) for _ in range(3)]
        self.obey(self.executive.on_task(Task('random', tuple(goals))))

    def _bodies(self):
        balls = [
            Obstacle(f'ball {i}', 'sphere', (0.12,), self.rng.normal(size=3) * 0.7, np.eye(3))
            for i in range(6)
        ]
        return capsule_model(self.chain, 0.02, balls, 0.005)

    def _free_posture(self):
        chain = self.chain
        for _ in range(50):
            q = self.rng.uniform(chain.operating_lower, chain.operating_upper)
            if self.model is None or not self.plain().touches(q):
                break
        return q

    def plain(self):
        return PlainChecker(self.model, np.zeros((0, 0)))

    def clock(self):
        return self.now + round(self.planning_takes * SECOND)

    def on_stop(self, motion, stamp):
        self.seen['stops'] += 1
        self.judge(motion)
        self.stops.append(motion)
        # The rest of the planning takes its time.
        self.planning_takes = self.rng.uniform(0.0, 0.3)

    def state(self):
        """Positions and speeds as measured; what is locked stands still."""
        q, v = self.stood.copy(), np.zeros(self.chain.n)
        if self.path is not None:
            q, v = self.path.sample((self.now - self.begun) / SECOND)
        for i, name in enumerate(self.chain.joint_names):
            if name in self.locked:
                q[i], v[i] = self.locked[name], 0.0
        return q, v

    def measure(self):
        q, v = self.state()
        names = self.chain.joint_names
        _, decision = self.executive.on_joint_state(
            self.now, dict(zip(names, q, strict=True)), dict(zip(names, v, strict=True))
        )
        self.obey(decision)

    def judge(self, motion):
        q, v = self.state()
        assert_safe(self.chain, motion, self.executive.frozen, q, v, PLANNING.jerk_time)

    def obey(self, decision):
        stops, self.stops, self.planning_takes = self.stops, [], 0.0
        if decision is None:
            return
        assert decision.stamp == self.now
        plan = decision.plan
        assert plan.status != 'refused', plan.reason
        self.judge(plan.trajectory)
        for stop in stops:
            early, whole = stop.path(), plan.trajectory.path()
            for time in np.linspace(0.0, stop.duration, 30):
                at, then = early.sample(time), whole.sample(time)
                assert max(np.abs(a - b).max() for a, b in zip(at, then, strict=True)) < 1e-9
        if self.model is not None:
            self.judge_clearance(plan)
        self.stood, _ = self.state()
        self.path, self.begun = plan.trajectory.path(), decision.stamp

    def judge_clearance(self, plan):
        """After the arm has stopped it touches nothing, by coal at many instants."""
        resting = np.abs(plan.trajectory.velocities).max(axis=1) < 1e-9
        visited = [o for o in plan.outcomes if o.has_posture]
        rests = np.sum(resting[1:] & ~resting[:-1])
        straight = [o for o in visited if o.target.straight_line]
        self.seen['detours'] += bool(visited and not straight and rests > len(visited) + 1)
        if 'not checked' in plan.reason or not visited:
            return
        begin = plan.trajectory.times[int(np.argmax(resting))]
        path, plain = plan.trajectory.path(), self.plain()
        for time in np.linspace(begin, plan.trajectory.duration, 150):
            assert not plain.touches(path.sample(time)[0])

    def run(self):
        for _ in range(int(self.rng.integers(3, 7))):
            self.now += round(self.rng.uniform(0.05, 1.5) * SECOND)
            self.measure()
            healthy = [name for name in self.chain.joint_names if name not in self.locked]
            if self.locked and (not healthy or self.rng.random() < 0.3):
                name = self.rng.choice(sorted(self.locked))
                self.seen['cleared'] += 1
                del self.locked[name]
            else:
                name = self.rng.choice(healthy)
                q, _ = self.state()
                self.locked[name] = float(q[self.chain.index(name)])
                self.seen[f'{len(self.locked)} locked'] += 1
            frozen = dict(self.locked)
            sigma = dict.fromkeys(frozen, 1e-5)
            self.obey(self.executive.on_fault_state(self.now, frozen, sigma))
            if self.executive.waiting:
                self.seen['waited'] += 1
                self.now += 10_000_000
                self.measure()
        return self.seen


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), bodies=st.booleans())
def test_no_unsafe_motion_leaves_during_recoveries(seed, bodies):
    Recovery(seed, bodies).run()


def test_recoveries_come_in_all_kinds():
    """The stories that the property is tried on do hold what it is there for."""
    seen = Counter()
    for seed in range(24):
        seen += Recovery(seed, bodies=True).run()
    for kind in ('stops', 'detours', 'cleared', 'waited', 'followers', '2 locked', '3 locked'):
        assert seen[kind] >= 2, (kind, seen)
