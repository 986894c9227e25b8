"""The secondary goal: a proved design made shorter, proved anew at every step."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from ft_manip_ros.core.design.candidate import DesignResult, ShouldStop
from ft_manip_ros.core.design.descent import descend_from
from ft_manip_ros.core.design.problem import DesignProblem

# Share of the total length kept by one step, and the finest step tried.
FIRST_STEP, FINEST_STEP = 0.9, 0.99


def shorten(
    problem: DesignProblem, result: DesignResult, should_stop: ShouldStop, seconds: float
) -> DesignResult:
    """Lower the bound on the sum of link lengths as long as a table below it is proved.

    Each bound starts a descent from the last proved table; where it fails, the step is halved.

    Parameters
    ----------
    result
        A proved design; what is returned is proved too.
    seconds
        Time to spend.
    """
    begin = time.monotonic()

    def stop() -> bool:
        return should_stop() or time.monotonic() - begin >= seconds

    p = problem.parameters(result.table)
    first = length = problem.space.length(p)
    step, attempt = FIRST_STEP, 0
    while step < FINEST_STEP and not stop():
        shorter = replace(problem, space=replace(problem.space, max_length=step * length))
        rng = np.random.default_rng([problem.settings.seed, attempt, 1])
        segment = descend_from(shorter, rng, p, stop)
        attempt += 1
        result = replace(
            result,
            iterations=result.iterations + segment.tried,
            evaluations=result.evaluations + segment.evaluations,
        )
        if segment.winner is None or not shorter.space.admits(segment.winner.parameters):
            step = 0.5 * (1.0 + step)
            continue
        p = segment.winner.parameters
        length = problem.space.length(p)
        result = replace(result, table=problem.table(p), proof=segment.proof)
    return replace(
        result,
        elapsed=result.elapsed + time.monotonic() - begin,
        reason=f'{result.reason}; total length {length:.3f} m, from {first:.3f} m',
    )
