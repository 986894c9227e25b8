"""The default method: descent over the DH table on a pool of worst cases.

A random table is scanned for its worst frozen angles. They join a pool of cases, and a damped
Gauss-Newton descent over the DH parameters lowers the pool's penalties: at a best posture the
gradient of a penalty over the table costs nothing more (envelope theorem), and the postures are
carried along as warm starts. When the pool is satisfied the table is scanned again; new worst
cases join, until a scan finds none. The FTWS engine then has the last word, and the angle at which
it refutes a table is the next case.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.design.candidate import Candidate, Segment, ShouldStop
from ft_manip_ros.core.design.cases import CasePool, PoolValue
from ft_manip_ros.core.design.dh_kernels import make_work
from ft_manip_ros.core.design.inner import INNER_METHODS
from ft_manip_ros.core.design.objective import Evaluation, Objective
from ft_manip_ros.core.design.problem import ZERO, DesignProblem
from ft_manip_ros.core.design.proof import Proof, prove
from ft_manip_ros.core.design.restarts import random_state
from ft_manip_ros.core.design.search_goals import TETRAHEDRON, with_positions
from ft_manip_ros.core.design.space import DesignSpace
from ft_manip_ros.core.ftws.verdict import Verdict

# Later attempts ask for less room around the goals, in case the task has no design with more.
MARGIN_SHARES = (1.0, 1.0, 0.5, 0.25)
# Volumes, and several failures at once, are harder to prove: there is more room to ask for.
MARGIN_SHARES_OF_HARD = (2.5, 2.0, 1.0, 0.5)
MAX_ROUNDS = 16
MAX_STEPS = 60
MAX_PROOFS = 3
# A refused proof of a volume shows one more point of it to mind; there may be many.
MAX_PROOFS_OF_REGIONS = 12
# Balls that the proof of a volume may take, by round of attempts. A table with room to spare takes
# few; one that takes many is rarely worth them.
MOST_CELLS = (300, 600, 1200, 2400, 5000)
# Room asked for around a point of a region that is not proved, as a share of the reach.
ROOM = 0.04
# Violated cases are pushed this far (m) past zero, so that steps do not only creep up to it.
OVERSHOOT = 0.003
# Longest step, in spans of the design space.
LONGEST_STEP = 0.3
# Give the attempt up where this many accepted steps took off less than this share.
PATIENCE, PROGRESS = 7, 0.3


def descent_segment(
    problem: DesignProblem, rng: np.random.Generator, attempt: int, should_stop: ShouldStop
) -> Segment:
    """Run one attempt from a random table to a proof, or until it gets stuck."""
    volumes = any(goal.region is not None for goal in problem.task.goals)
    hard = volumes or problem.spec.order > 1
    shares = MARGIN_SHARES_OF_HARD if hard else MARGIN_SHARES
    cells = MOST_CELLS[min(attempt // len(shares), len(MOST_CELLS) - 1)]
    return _Attempt(problem, rng, shares[attempt % len(shares)], should_stop, cells).run()


def descend_from(
    problem: DesignProblem, rng: np.random.Generator, p: Array, should_stop: ShouldStop
) -> Segment:
    """Run one attempt from the table ``p`` (3n,), made admissible first."""
    attempt = _Attempt(problem, rng, MARGIN_SHARES[-1], should_stop, MOST_CELLS[-1])
    attempt.p = problem.space.project(p)
    return attempt.run()


class _Attempt:
    def __init__(
        self,
        problem: DesignProblem,
        rng: np.random.Generator,
        share: float,
        stop: ShouldStop,
        most_cells: int,
    ) -> None:
        self.problem = problem
        self.stop = stop
        self.most_cells = most_cells
        self.p = problem.space.sample(rng)
        goals, limits = problem.guarded(share)
        self.objective = Objective(problem, rng, goals=goals, limits=limits)
        self.pool = CasePool(
            goals, limits, problem.sets, INNER_METHODS.index(problem.settings.inner_method),
            random_state(rng), make_work(problem.spec.dof),
        )  # fmt: skip
        self.candidates: list[Candidate] = []
        self.tried = 0
        self.accepted = 0
        regions = any(goal.region is not None for goal in problem.task.goals)
        self.proofs_left = MAX_PROOFS_OF_REGIONS if regions else MAX_PROOFS
        self.refused: Array | None = None
        self.proof: Proof | None = None

    def run(self) -> Segment:
        for _ in range(MAX_ROUNDS):
            evaluation = self.objective.evaluate(self.p)
            self._note(evaluation)
            if evaluation.total > 0.0:
                self._add_worst(evaluation)
            elif not self.problem.settings.prove or self._proved():
                return self._segment(self.candidates[-1])
            if self.stop() or self.proofs_left <= 0 or not self._descend():
                break
        return self._segment(None)

    def _note(self, evaluation: Evaluation) -> None:
        # The points around the task's own are not in equation 7.
        shares = self.problem.per_goal(evaluation.point_penalties)
        self.tried += 1
        self.candidates.append(
            Candidate(
                self.p.copy(),
                float(shares.sum()),
                tuple(float(x) for x in shares),
                0.0,
                self.accepted / max(self.tried, 1),
                self.tried,
            )
        )

    def _add_worst(self, evaluation: Evaluation) -> None:
        for goal, subset in np.argwhere(evaluation.worst > 0.0):
            self.pool.add(int(goal), int(subset), evaluation.postures[goal, subset])

    def _proved(self) -> bool:
        if self.refused is not None and np.array_equal(self.p, self.refused):
            # What the last refusal taught changed nothing: leave this table for good.
            self.proofs_left = 0
            return False
        self.refused = self.p
        self.proofs_left -= 1
        table = self.problem.table(self.p)
        self.proof = prove(
            table.chain(),
            self.problem.task,
            self.problem.spec.order,
            self.stop,
            most_cells=self.most_cells,
        )
        if self.proof.proved:
            return True
        last = self.proof.verdicts[-1]
        names = [joint.name for joint in table.joints]
        joints = [names.index(name) for name in last.joints]
        goal = len(self.proof.verdicts) - 1
        region = self.problem.task.goals[goal].region
        if last.verdict is Verdict.NON_MEMBER and joints:
            self._add_refuted(self._failed_point(goal), joints, last.angles)
        elif region is not None:
            self._add_around(goal)
        else:
            # Nothing to learn from: leave this table for good.
            self.proofs_left = 0
        return False

    def _failed_point(self, goal: int) -> int:
        """Index of the point at which the last proof failed among the points searched for."""
        assert self.proof is not None
        at = self.proof.failed_at
        if at is None or np.array_equal(at, self.problem.goals.positions[goal]):
            return goal
        return self._add_points(goal, at[None])

    def _add_around(self, goal: int) -> None:
        """Ask for room around the point at which the last proof failed.

        Such a point is near the edge of some ROD's work space, so that one of those around it is
        likely to be out of reach: something to descend on.
        """
        assert self.proof is not None and self.proof.failed_at is not None
        room = self.problem.reach * ROOM * TETRAHEDRON
        self._add_points(goal, self.proof.failed_at + np.concatenate([np.zeros((1, 3)), room]))

    def _add_points(self, goal: int, positions: Array) -> int:
        first = len(self.pool.goals.positions)
        self.pool.goals = with_positions(self.pool.goals, goal, positions)
        self.objective.set_goals(self.pool.goals)
        return first

    def _add_refuted(self, goal: int, joints: Sequence[int], angles: Sequence[float]) -> None:
        order = np.argsort(joints)
        chosen = np.array(joints)[order]
        posture = 0.5 * (self.problem.limits.lower + self.problem.limits.upper)
        posture[chosen] = np.array(angles)[order]
        for subset, frozen in enumerate(self.problem.sets.frozen):
            if np.array_equal(frozen, chosen):
                self.pool.add(goal, subset, posture)

    def _descend(self) -> bool:
        """Lower the pool's penalties to zero; False where the descent gets stuck."""
        problem, pool = self.problem, self.pool
        at = pool.evaluate(problem.rows(self.p))
        damping = 1e-2
        history = [at.total]
        for _ in range(MAX_STEPS):
            if at.total <= ZERO:
                return True
            if self.stop() or damping > 1e4:
                return False
            p = problem.space.moved(self.p, _step(problem.space, self.p, at, damping))
            trial = pool.evaluate(problem.rows(p), restarts=1, give_up=at.total)
            self.tried += 1
            if trial.total >= at.total:
                damping *= 4.0
                continue
            self.accepted += 1
            self.p, at = p, trial
            pool.keep(trial)
            damping = max(0.3 * damping, 1e-6)
            history.append(at.total)
            if len(history) > PATIENCE and at.total > (1.0 - PROGRESS) * history[-PATIENCE - 1]:
                return False
        return False

    def _segment(self, winner: Candidate | None) -> Segment:
        evaluations = self.objective.evaluations + self.pool.evaluations
        proof = self.proof if winner is not None else None
        return Segment(
            tuple(self.candidates), winner, proof, self.proof, None, self.tried, evaluations
        )


def _step(space: DesignSpace, p: Array, at: PoolValue, damping: float) -> Array:
    """Damped Gauss-Newton step on the square roots of the penalties of violated cases."""
    active = at.values > ZERO
    rows = space.to_variables(at.slopes[active])
    distance = np.sqrt(at.values[active]) + OVERSHOOT
    moving = space.movable(p, rows.T @ distance)
    rows = rows[:, moving]
    normal = rows.T @ rows
    normal[np.diag_indices_from(normal)] += damping
    step = np.zeros(space.size)
    step[moving] = -np.linalg.solve(normal, rows.T @ distance)
    length = float(np.linalg.norm(step))
    return step if length <= LONGEST_STEP else step * (LONGEST_STEP / length)
