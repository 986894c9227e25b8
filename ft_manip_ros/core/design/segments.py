"""One unit of work of the search: what a thread, a process or a cluster worker runs."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ft_manip_ros.core.design.annealing import annealing_segment
from ft_manip_ros.core.design.candidate import Segment, ShouldStop
from ft_manip_ros.core.design.descent import descent_segment
from ft_manip_ros.core.design.problem import DesignProblem


def never() -> bool:
    """Return False: nobody asks to stop."""
    return False


def run_segment(
    problem: DesignProblem,
    slot: int,
    index: int,
    state: Mapping[str, Any] | None,
    seconds: float,
    should_stop: ShouldStop = never,
) -> Segment:
    """Run unit ``index`` of chain ``slot``.

    The outcome depends on problem, slot, index and state alone, unless ``seconds`` run out or
    ``should_stop`` says so: which worker runs it, beside what, changes nothing.
    """
    end = time.monotonic() + seconds

    stopped = False

    def stop() -> bool:
        nonlocal stopped
        stopped = stopped or should_stop() or time.monotonic() >= end
        return stopped

    rng = np.random.default_rng([problem.settings.seed, slot, index])
    if problem.settings.method == 'worst_cases':
        attempt = index * problem.settings.slots + slot
        segment = descent_segment(problem, rng, attempt, stop)
    else:
        segment = annealing_segment(problem, rng, state, stop)
    return replace(segment, complete=not stopped or segment.winner is not None)
