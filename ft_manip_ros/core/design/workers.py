"""Who runs the segments: threads here, processes here, or the workers of a Dask cluster."""

from __future__ import annotations

import math
import multiprocessing
from collections.abc import Mapping
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.synchronize import Event
from typing import Any, Protocol

from ft_manip_ros.core.design.candidate import Segment, ShouldStop
from ft_manip_ros.core.design.problem import DesignProblem
from ft_manip_ros.core.design.segments import run_segment
from ft_manip_ros.core.errors import InputError

# Set in a worker process: the event that tells it to leave its segment.
_stop_event: Event | None = None


class Workers(Protocol):
    """A pool that runs segments.

    Attributes
    ----------
    losses
        Exceptions of a future that mean "the worker was lost": the segment is run again.
    grace
        s to wait for segments under way once the search has ended.
    """

    losses: tuple[type[BaseException], ...]
    grace: float

    def submit(
        self,
        problem: DesignProblem,
        slot: int,
        index: int,
        state: Mapping[str, Any] | None,
        seconds: float,
        should_stop: ShouldStop,
    ) -> Future[Segment]:
        """Run `run_segment` with these arguments."""

    def stop(self) -> None:
        """Tell workers that cannot see ``should_stop`` to leave their segments."""

    def renew(self) -> None:
        """Replace workers that were lost; segments under way are lost with them."""

    def close(self) -> None:
        """Let go of the workers; segments under way end early where they can be told."""


class ThreadWorkers:
    """Threads of this process: the kernels run without the interpreter's lock."""

    losses: tuple[type[BaseException], ...] = ()
    grace = math.inf

    def __init__(self, count: int) -> None:
        self._pool = ThreadPoolExecutor(count, 'design')

    def submit(
        self, problem: DesignProblem, slot: int, index: int, state: Mapping[str, Any] | None,
        seconds: float, should_stop: ShouldStop,
    ) -> Future[Segment]:  # fmt: skip
        """Run a segment in a thread; it polls ``should_stop``."""
        return self._pool.submit(run_segment, problem, slot, index, state, seconds, should_stop)

    def stop(self) -> None:
        """Threads poll ``should_stop``."""

    def renew(self) -> None:
        """Threads are not lost."""

    def close(self) -> None:
        """Wait for the threads."""
        self._pool.shutdown()


class ProcessWorkers:
    """Processes on this machine; one that is killed is replaced and its segment run again."""

    losses: tuple[type[BaseException], ...] = (BrokenProcessPool,)
    grace = 2.0

    def __init__(self, count: int) -> None:
        self._count = count
        # A forked child would inherit threads' locks in whatever state they are.
        self._context = multiprocessing.get_context('spawn')
        self._stop = self._context.Event()
        self._pool = self._start()

    def _start(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            self._count, self._context, initializer=_set_stop_event, initargs=(self._stop,)
        )

    def submit(
        self, problem: DesignProblem, slot: int, index: int, state: Mapping[str, Any] | None,
        seconds: float, should_stop: ShouldStop,
    ) -> Future[Segment]:  # fmt: skip
        """Run a segment in a process; ``should_stop`` stays here, `close` tells the process."""
        return self._pool.submit(_run_in_process, problem, slot, index, state, seconds)

    def stop(self) -> None:
        """Set the event that the processes poll."""
        self._stop.set()

    def renew(self) -> None:
        """Start new processes."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        self._pool = self._start()

    def close(self) -> None:
        """Tell the processes to leave their segments, and wait for them."""
        self._stop.set()
        self._pool.shutdown(cancel_futures=True)


class DaskWorkers:
    """Workers of a Dask cluster, which reruns the segments of workers that it loses."""

    grace = 0.0

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
            from distributed.scheduler import KilledWorker
        except ImportError:
            raise InputError(
                'scheduler', 'needs the package dask.distributed (pip install distributed)'
            ) from None
        self.losses: tuple[type[BaseException], ...] = (KilledWorker,)
        try:
            self._client = Client(address, timeout=10, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError('scheduler', f'{address!r} does not answer: {error}') from error
        self._pool = self._client.get_executor(pure=False)

    def submit(
        self, problem: DesignProblem, slot: int, index: int, state: Mapping[str, Any] | None,
        seconds: float, should_stop: ShouldStop,
    ) -> Future[Segment]:  # fmt: skip
        """Run a segment on the cluster."""
        future: Future[Segment] = self._pool.submit(
            run_segment, problem, slot, index, state, seconds
        )
        return future

    def stop(self) -> None:
        """Nothing reaches a segment on the cluster; `close` cancels those not begun."""

    def renew(self) -> None:
        """The cluster looks after its workers."""

    def close(self) -> None:
        """Cancel what is under way and leave the cluster."""
        # Without waiting, Dask's executor cancels what it holds.
        self._pool.shutdown(wait=False)
        self._client.close()


def open_workers(problem: DesignProblem) -> Workers:
    """Return the workers that the settings ask for."""
    settings = problem.settings
    if settings.scheduler:
        return DaskWorkers(settings.scheduler)
    if settings.executor == 'processes':
        return ProcessWorkers(settings.workers)
    return ThreadWorkers(settings.workers)


def _set_stop_event(event: Event) -> None:
    global _stop_event
    _stop_event = event


def _run_in_process(
    problem: DesignProblem, slot: int, index: int, state: Mapping[str, Any] | None, seconds: float
) -> Segment:
    assert _stop_event is not None
    return run_segment(problem, slot, index, state, seconds, _stop_event.is_set)
