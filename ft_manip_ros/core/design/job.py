"""A design search in a thread of its own: start, watch, stop, and take the result."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from queue import Empty, SimpleQueue

import numpy as np

from ft_manip_ros.core.design.candidate import Candidate, DesignResult
from ft_manip_ros.core.design.certificate import opinion, write_certificate
from ft_manip_ros.core.design.problem import ZERO, design_problem
from ft_manip_ros.core.design.search import design_arm
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import DesignSpec, Task


class DesignJob:
    """A search that runs beside its caller.

    Attributes
    ----------
    task, spec, settings
        What is searched for.
    latest, best
        Last accepted candidate and the best one so far; None before the first.
    result
        None until the search has ended, and where it failed.
    error
        What ended the search where it failed.

    Parameters
    ----------
    certificate, report
        Files for the proofs of a proved design and for the picture; empty for none. They are
        written before the job is done, and the result's reason says what came of it.
    """

    def __init__(
        self,
        task: Task,
        spec: DesignSpec,
        settings: DesignSettings,
        *,
        certificate: str = '',
        report: str = '',
    ) -> None:
        self.task, self.spec, self.settings = task, spec, settings
        self._certificate, self._report = certificate, report
        self._penalties: list[float] = []
        self.latest: Candidate | None = None
        self.best: Candidate | None = None
        self.result: DesignResult | None = None
        self.error: Exception | None = None
        # When the penalty was first known and what it was, and when it last fell.
        self._first: tuple[float, float] | None = None
        self._improved = 0.0
        self._news: SimpleQueue[tuple[Candidate, bool]] = SimpleQueue()
        self._stop = threading.Event()
        self._done = threading.Event()
        self._started = time.monotonic()
        self._thread = threading.Thread(target=self._run, name='design search', daemon=True)
        self._thread.start()

    @property
    def elapsed(self) -> float:
        """Time since the start, s."""
        return time.monotonic() - self._started

    @property
    def done(self) -> bool:
        """True when the search has ended."""
        return self._done.is_set()

    def eta(self) -> float:
        """Time to penalty zero if the best penalty kept falling as it has (s), a rough guess.

        Zero where it is reached and only the proof is missing; infinite before it has fallen.
        """
        if self.best is None or self._first is None:
            return np.inf
        if self.best.penalty <= ZERO:
            return 0.0
        fallen = float(np.log(self._first[1] / self.best.penalty))
        if fallen <= 0.0 or not np.isfinite(fallen):
            return np.inf
        taken = self._improved - self._first[0]
        return taken * float(np.log(self.best.penalty / ZERO)) / fallen

    def stop(self) -> None:
        """Ask the search to end with its best design; returns at once."""
        self._stop.set()

    def wait(self, timeout: float) -> bool:
        """Wait for the end for up to ``timeout`` s; return whether it came."""
        return self._done.wait(timeout)

    def take_news(self) -> list[tuple[Candidate, bool]]:
        """Candidates accepted since the last call, each with whether it was the best so far."""
        news = []
        while True:
            try:
                news.append(self._news.get_nowait())
            except Empty:
                return news

    def _run(self) -> None:
        try:
            result = design_arm(
                self.task,
                self.spec,
                self.settings,
                on_candidate=self._on_candidate,
                should_stop=self._stop.is_set,
            )
            notes = '; '.join([result.reason, *self._write_files(result)])
            self.result = replace(result, reason=notes)
        except Exception as error:  # noqa: BLE001 - handed to whoever waits for the result
            self.error = error
        finally:
            self._done.set()

    def _write_files(self, result: DesignResult) -> Iterator[str]:
        """Write what was asked for; yield what there is to say of it."""
        problem = design_problem(self.task, self.spec, self.settings)
        if self._certificate and not result.proved:
            yield 'no certificate, as nothing is proved'
        elif self._certificate:
            try:
                outcomes = write_certificate(
                    self._certificate, result.table.chain(), problem.task, self.spec.order,
                    self._stop.is_set,
                )  # fmt: skip
                yield opinion(outcomes)
            except InputError as error:
                yield f'no certificate: {error}'
        if self._report and self._stop.is_set():
            yield 'no report, as the search was stopped'
        elif self._report:
            # Loading matplotlib takes seconds that a search without a report does not need.
            from ft_manip_ros.core.design.report import write_report

            try:
                write_report(self._report, problem, result, self._penalties)
            except InputError as error:
                yield f'no report: {error}'

    def _on_candidate(self, candidate: Candidate, best: Candidate) -> None:
        if candidate is best:
            self._improved = self.elapsed
            self._first = self._first or (self._improved, candidate.penalty)
        self.latest, self.best = candidate, best
        self._penalties.append(candidate.penalty)
        self._news.put((candidate, candidate is best))
