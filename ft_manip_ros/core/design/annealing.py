"""Simulated annealing over the DH table (equation 10), stopped at zero penalty.

``paredis_1994`` evaluates every candidate whole, with P* and the hybrid minimisation.
``annealing`` draws the random number of equation 10 first, which turns it into a threshold: a
candidate is dropped at the first worst case that takes it past the threshold, with the very
decision that equation 10 would have made.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.design.candidate import Candidate, Segment, ShouldStop
from ft_manip_ros.core.design.objective import Evaluation, Objective
from ft_manip_ros.core.design.problem import DesignProblem
from ft_manip_ros.core.design.proof import Proof, prove

# Tables tried in one unit of work: about half a second of either method.
SEGMENT_TABLES = {'annealing': 80, 'paredis_1994': 8}
COOLING = 0.985
FIRST_MOVES = 12
# A chain is frozen after so many tables without an accepted one, and starts anew.
FROZEN_AFTER = 80
# Recent tables that the acceptance rate speaks of: weight of each new one.
RATE_WEIGHT = 0.05
SPREAD_LIMITS = (0.005, 0.3)


def first_temperature(rises: Array, acceptance: float = 0.9) -> float:
    """Temperature at which the mean of ``rises`` (> 0) is accepted with this probability."""
    uphill = rises[rises > 0.0]
    if len(uphill) == 0:
        return 1e-6
    return float(uphill.mean() / -math.log(acceptance))


def threshold(penalty: float, temperature: float, random: float) -> float:
    """Largest penalty that equation 10 accepts after ``penalty``, for a draw in [0, 1).

    ``exp(-dF/T) > random`` is ``dF < -T ln(random)``.
    """
    if random <= 0.0:
        return math.inf
    return penalty - temperature * math.log(random)


def annealing_segment(
    problem: DesignProblem,
    rng: np.random.Generator,
    state: Mapping[str, Any] | None,
    should_stop: ShouldStop,
) -> Segment:
    """Advance one chain by a unit of work from ``state`` (None: a new chain)."""
    return _Chain(problem, rng, state, should_stop).run()


class _Chain:
    def __init__(
        self,
        problem: DesignProblem,
        rng: np.random.Generator,
        state: Mapping[str, Any] | None,
        stop: ShouldStop,
    ) -> None:
        self.problem, self.rng, self.stop = problem, rng, stop
        self.paper = problem.settings.method == 'paredis_1994'
        self.objective = Objective(problem, rng)
        self.candidates: list[Candidate] = []
        self.tried = 0
        self.proof: Proof | None = None
        if state is None:
            self._start()
        else:
            self.p = np.array(state['p'])
            self.temperature = float(state['temperature'])
            self.spread = float(state['spread'])
            self.rate = float(state['rate'])
            self.idle = int(state['idle'])
            self.penalty = float(state['penalty'])

    def run(self) -> Segment:
        winner = None
        limit = SEGMENT_TABLES[self.problem.settings.method]
        while winner is None and self.tried < limit and not self.stop():
            if self.idle >= FROZEN_AFTER:
                self._start()
            winner = self._try()
        state = {
            'p': self.p.tolist(),
            'temperature': self.temperature,
            'spread': self.spread,
            'rate': self.rate,
            'idle': self.idle,
            'penalty': self.penalty,
        }
        proof = self.proof if winner is not None else None
        return Segment(
            tuple(self.candidates), winner, proof, self.proof, state, self.tried,
            self.objective.evaluations,
        )  # fmt: skip

    def _start(self) -> None:
        """Begin at a random table, hot enough to accept nearly every move."""
        space = self.problem.space
        self.p = space.sample(self.rng)
        self.spread = SPREAD_LIMITS[1]
        self.penalty = self._value(self.p, math.inf).total
        moves = [
            self._value(space.neighbour(self.p, self.spread, self.rng), math.inf).total
            for _ in range(FIRST_MOVES)
        ]
        self.temperature = first_temperature(np.array(moves) - self.penalty)
        self.rate = 1.0
        self.idle = 0

    def _value(self, p: Array, give_up: float) -> Evaluation:
        self.tried += 1
        if self.paper:
            # The paper's objective is a function of the table alone.
            self.objective.forget()
        return self.objective.evaluate(p, give_up)

    def _try(self) -> Candidate | None:
        """Try one neighbour; return it where it is zero and proved."""
        p = self.problem.space.neighbour(self.p, self.spread, self.rng)
        limit = threshold(self.penalty, self.temperature, self.rng.random())
        evaluation = self._value(p, math.inf if self.paper else limit)
        # dF <= 0 accepts also at temperature zero, where the threshold is the penalty itself.
        accepted = evaluation.complete and evaluation.total <= max(limit, self.penalty)
        self.temperature *= COOLING
        self.rate += RATE_WEIGHT * (float(accepted) - self.rate)
        self.spread = float(np.clip(self.spread * (1.05 if accepted else 0.98), *SPREAD_LIMITS))
        if not accepted:
            self.idle += 1
            return None
        moved = evaluation.total != self.penalty or self.penalty > 0.0
        self.idle = 0 if moved else self.idle + 1
        self.p, self.penalty = p, evaluation.total
        candidate = Candidate(
            p.copy(),
            evaluation.total,
            tuple(float(x) for x in self.problem.per_goal(evaluation.point_penalties)),
            self.temperature,
            self.rate,
            self.tried,
        )
        self.candidates.append(candidate)
        if evaluation.total > 0.0:
            return None
        if not self.problem.settings.prove:
            return candidate
        table = self.problem.table(p)
        self.proof = prove(table.chain(), self.problem.task, self.problem.spec.order, self.stop)
        return candidate if self.proof.proved else None
