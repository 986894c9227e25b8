"""The design search: chains of segments, side by side, until a table is proved."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from dataclasses import replace
from typing import Any

import numpy as np

from ft_manip_ros.core.design.candidate import Candidate, DesignResult, Segment, ShouldStop
from ft_manip_ros.core.design.problem import DesignProblem, design_problem
from ft_manip_ros.core.design.proof import Proof
from ft_manip_ros.core.design.segments import never, run_segment
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.design.warm_up import warm_up
from ft_manip_ros.core.goal import DesignSpec, Task

# Place of a segment in the order that decides who wins: (index within its chain, chain).
Key = tuple[int, int]
# Called for every accepted candidate, in a fixed order, with the best one so far.
OnCandidate = Callable[[Candidate, Candidate], None]

_POLL = 0.1  # s


def design_arm(
    task: Task,
    spec: DesignSpec | None = None,
    settings: DesignSettings | None = None,
    *,
    on_candidate: OnCandidate | None = None,
    should_stop: ShouldStop = never,
) -> DesignResult:
    """Search for a DH table whose FTWS contains every goal of ``task`` (equation 7).

    A design is announced (``proved``) only when the FTWS engine has proved every goal a member.
    The same task, specification and settings give the same result whatever ``workers`` is, unless
    the time budget ends the search or ``should_stop`` does.

    Parameters
    ----------
    spec
        Joints, order and limits; by default the task's own.
    on_candidate
        Called from this thread with each accepted candidate and the best one so far.
    should_stop
        Polled often; once true, the search ends with its best design.

    Raises
    ------
    InputError
        For settings or a specification that cannot be used.
    """
    problem = design_problem(task, spec, settings)
    warm_up(problem)
    search = _Search(problem, on_candidate, should_stop)
    with ThreadPoolExecutor(problem.settings.workers, 'design') as executor:
        return search.run(executor)


class _Search:
    def __init__(
        self, problem: DesignProblem, on_candidate: OnCandidate | None, should_stop: ShouldStop
    ) -> None:
        self.problem = problem
        self.settings = problem.settings
        self.on_candidate = on_candidate
        self.should_stop = should_stop
        self.begin = time.monotonic()
        self.iterations = 0
        self.evaluations = 0
        self.best: Candidate | None = None
        self.last_proof: Proof | None = None
        self.winner: tuple[Key, Segment] | None = None
        self.states: dict[int, Mapping[str, Any] | None] = {}
        self.ready: list[Key] = [(0, slot) for slot in range(self.settings.slots)]
        self.running: dict[Future[Segment], Key] = {}
        self.finished: dict[Key, Segment] = {}
        self.next: Key = (0, 0)

    def run(self, executor: Executor) -> DesignResult:
        while True:
            if not self._ended():
                self._dispatch(executor)
            if not self.running:
                break
            done, _ = wait(self.running, timeout=_POLL, return_when=FIRST_COMPLETED)
            for future in done:
                self._finish(self.running.pop(future), future.result())
            self._deliver()
        self._deliver()
        return self._result()

    def _ended(self) -> bool:
        return self.should_stop() or self._left() <= 0.0

    def _left(self) -> float:
        return self.settings.time_budget - (time.monotonic() - self.begin)

    def _dispatch(self, executor: Executor) -> None:
        while self.ready and len(self.running) < self.settings.workers:
            key = min(self.ready)
            if self._beaten(key) or self._beyond(key):
                return
            self.ready.remove(key)
            index, slot = key
            future = executor.submit(
                run_segment,
                self.problem,
                slot,
                index,
                self.states.get(slot),
                self._left(),
                self._stop_of(key),
            )
            self.running[future] = key

    def _stop_of(self, key: Key) -> ShouldStop:
        return lambda: self.should_stop() or self._beaten(key)

    def _beaten(self, key: Key) -> bool:
        return self.winner is not None and key > self.winner[0]

    def _beyond(self, key: Key) -> bool:
        limit = self.settings.max_segments
        return limit > 0 and key[0] * self.settings.slots + key[1] >= limit

    def _finish(self, key: Key, segment: Segment) -> None:
        index, slot = key
        self.states[slot] = segment.state
        self.ready.append((index + 1, slot))
        self.finished[key] = segment
        if segment.winner is not None and not self._beaten(key):
            self.winner = (key, segment)

    def _deliver(self) -> None:
        """Count and pass on finished segments in their order, up to the winner."""
        while self.next in self.finished and not self._beaten(self.next):
            segment = self.finished.pop(self.next)
            for candidate in segment.candidates:
                counted = replace(candidate, iteration=self.iterations + candidate.iteration)
                if candidate is segment.winner or (
                    self.best is None or counted.penalty < self.best.penalty
                ):
                    self.best = counted
                if self.on_candidate is not None:
                    assert self.best is not None
                    self.on_candidate(counted, self.best)
            self.iterations += segment.tried
            self.evaluations += segment.evaluations
            self.last_proof = segment.best_proof or self.last_proof
            index, slot = self.next
            last = slot + 1 == self.settings.slots
            self.next = (index + 1, 0) if last else (index, slot + 1)

    def _result(self) -> DesignResult:
        best = self.best
        if best is None:
            # Stopped before the first table was valued: say so with a table that is admissible.
            p = self.problem.space.sample(np.random.default_rng(self.settings.seed))
            best = Candidate(p, np.inf, (np.inf,) * self.problem.goal_count, 0.0, 0.0, 0)
        proof = None if self.winner is None else self.winner[1].proof
        return DesignResult(
            self.problem.table(best.parameters),
            best.penalty,
            best.goal_penalties,
            proof is not None and proof.proved,
            proof,
            self.iterations,
            self.evaluations,
            time.monotonic() - self.begin,
            self._reason(proof, best),
        )

    def _reason(self, proof: Proof | None, best: Candidate) -> str:
        if proof is not None:
            return proof.reason
        if self.winner is not None:
            return 'penalty zero; no proof was asked for'
        if self.should_stop():
            ended = 'stopped on request'
        elif self._left() <= 0.0:
            ended = f'the time budget of {self.settings.time_budget:g} s is spent'
        else:
            ended = f'the budget of {self.settings.max_segments} segments is spent'
        text = f'{ended} without a proved design; lowest penalty {best.penalty:.3g}'
        if self.last_proof is not None:
            text += f'; the last proof failed: {self.last_proof.reason}'
        return text
