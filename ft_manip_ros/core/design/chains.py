"""Chains of segments side by side: who runs next, what counts, who wins."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import replace
from typing import Any

import numpy as np

from ft_manip_ros.core.design.candidate import Candidate, DesignResult, Segment, ShouldStop
from ft_manip_ros.core.design.checkpoint import Checkpoint, CheckpointFile
from ft_manip_ros.core.design.problem import DesignProblem
from ft_manip_ros.core.design.proof import Proof
from ft_manip_ros.core.design.workers import Workers

# Place of a segment in the order that decides who wins: (index within its chain, chain).
Key = tuple[int, int]
# Called for every accepted candidate, in a fixed order, with the best one so far.
OnCandidate = Callable[[Candidate, Candidate], None]

_POLL = 0.1  # s
# A machine on which workers keep dying will not get better by starting more.
_MAX_RENEWALS = 20


class ChainSearch:
    """One search; see `search.design_arm`.

    Segments are done in any order and counted in one fixed order, so that neither the number nor
    the speed of the workers shows in the outcome.
    """

    def __init__(
        self,
        problem: DesignProblem,
        on_candidate: OnCandidate | None,
        should_stop: ShouldStop,
        file: CheckpointFile | None,
    ) -> None:
        self.problem = problem
        self.settings = problem.settings
        self.on_candidate = on_candidate
        self.should_stop = should_stop
        self.file = file
        self.begin = time.monotonic()
        self.earlier = 0.0
        self.renewals = 0
        self.iterations = 0
        self.evaluations = 0
        self.best: Candidate | None = None
        self.last_proof: Proof | None = None
        self.winner: tuple[Key, Segment] | None = None
        # States of the chains after their last finished, and after their last delivered segment.
        self.states: dict[int, Mapping[str, Any] | None] = {}
        self.delivered: dict[int, Mapping[str, Any] | None] = {}
        self.ready: list[Key] = [(0, slot) for slot in range(self.settings.slots)]
        self.running: dict[Future[Segment], Key] = {}
        self.finished: dict[Key, Segment] = {}
        self.cut: list[Segment] = []
        self.next: Key = (0, 0)

    def take_up(self, checkpoint: Checkpoint) -> None:
        """Go on from a checkpoint."""
        index, first = self.next = checkpoint.next
        self.states = dict(checkpoint.states)
        self.delivered = dict(checkpoint.states)
        self.ready = [
            (index + (1 if slot < first else 0), slot) for slot in range(self.settings.slots)
        ]
        self.best = checkpoint.best
        self.iterations = checkpoint.iterations
        self.evaluations = checkpoint.evaluations
        self.earlier = checkpoint.elapsed

    def run(self, workers: Workers) -> DesignResult:
        """Search until a table is proved, the budget is spent or somebody asks to stop."""
        self.begin = time.monotonic()
        give_up = np.inf
        while True:
            if not self._ended():
                self._dispatch(workers)
            else:
                workers.stop()
                give_up = min(give_up, time.monotonic() + workers.grace)
            wanted = [future for future, key in self.running.items() if not self._beaten(key)]
            if not wanted or time.monotonic() > give_up:
                break
            done, _ = wait(wanted, timeout=_POLL, return_when=FIRST_COMPLETED)
            for future in done:
                self._collect(future, workers)
            self._deliver()
        self._deliver()
        if self.file is not None:
            if self.winner is None:
                self.file.write(self._checkpoint(), now=True)
            else:
                self.file.remove()
        for segment in self.cut if self.winner is None else ():
            self._pass_on(segment)
            self.iterations += segment.tried
            self.evaluations += segment.evaluations
        return self._result()

    def _elapsed(self) -> float:
        return self.earlier + time.monotonic() - self.begin

    def _ended(self) -> bool:
        return self.should_stop() or self._left() <= 0.0

    def _left(self) -> float:
        return self.settings.time_budget - self._elapsed()

    def _dispatch(self, workers: Workers) -> None:
        while self.ready and len(self.running) < self.settings.workers:
            key = min(self.ready)
            if self._beaten(key) or self._beyond(key):
                return
            self.ready.remove(key)
            index, slot = key
            future = workers.submit(
                self.problem, slot, index, self.states.get(slot), self._left(), self._stop_of(key)
            )
            self.running[future] = key

    def _collect(self, future: Future[Segment], workers: Workers) -> None:
        try:
            segment = future.result()
        except workers.losses:
            # A lost worker costs time, not the search: its segments are run again.
            self.renewals += 1
            if self.renewals > _MAX_RENEWALS:
                raise
            self.ready += self.running.values()
            self.running.clear()
            workers.renew()
            return
        if future in self.running:
            self._finish(self.running.pop(future), segment)

    def _checkpoint(self) -> Checkpoint:
        return Checkpoint(
            self.next,
            self.delivered,
            self.best,
            self.iterations,
            self.evaluations,
            self._elapsed(),
        )

    def _stop_of(self, key: Key) -> ShouldStop:
        return lambda: self.should_stop() or self._beaten(key)

    def _beaten(self, key: Key) -> bool:
        return self.winner is not None and key > self.winner[0]

    def _beyond(self, key: Key) -> bool:
        limit = self.settings.max_segments
        return limit > 0 and key[0] * self.settings.slots + key[1] >= limit

    def _finish(self, key: Key, segment: Segment) -> None:
        if not segment.complete:
            # Cut short: it may hold the best table, but does not count, and is done anew later.
            self.cut.append(segment)
            return
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
            self._pass_on(segment)
            self.iterations += segment.tried
            self.evaluations += segment.evaluations
            self.last_proof = segment.best_proof or self.last_proof
            index, slot = self.next
            self.delivered[slot] = segment.state
            last = slot + 1 == self.settings.slots
            self.next = (index + 1, 0) if last else (index, slot + 1)
            if self.file is not None and segment.winner is None:
                self.file.write(self._checkpoint())

    def _pass_on(self, segment: Segment) -> None:
        for candidate in segment.candidates:
            counted = replace(candidate, iteration=self.iterations + candidate.iteration)
            if candidate is segment.winner or (
                self.best is None or counted.penalty < self.best.penalty
            ):
                self.best = counted
            if self.on_candidate is not None:
                assert self.best is not None
                self.on_candidate(counted, self.best)

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
            self._elapsed(),
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
