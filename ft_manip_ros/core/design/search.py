"""The design search: from a task to a table that is proved, or to the best one found."""

from __future__ import annotations

import os

from ft_manip_ros.core.design.candidate import DesignResult, ShouldStop
from ft_manip_ros.core.design.chains import ChainSearch, OnCandidate
from ft_manip_ros.core.design.checkpoint import CheckpointFile
from ft_manip_ros.core.design.problem import design_problem
from ft_manip_ros.core.design.segments import never
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.design.shorten import shorten
from ft_manip_ros.core.design.warm_up import warm_up
from ft_manip_ros.core.design.workers import open_workers
from ft_manip_ros.core.goal import DesignSpec, Task


def design_arm(
    task: Task,
    spec: DesignSpec | None = None,
    settings: DesignSettings | None = None,
    *,
    on_candidate: OnCandidate | None = None,
    should_stop: ShouldStop = never,
    checkpoint: str | os.PathLike[str] | None = None,
    resume: bool = False,
) -> DesignResult:
    """Search for a DH table whose FTWS contains every goal of ``task`` (equation 7).

    A design is announced (``proved``) only when the FTWS engine has proved every goal a member.
    The same task, specification and settings give the same result whatever the workers are,
    unless the time budget ends the search or ``should_stop`` does.

    Parameters
    ----------
    spec
        Joints, order and limits; by default the task's own.
    on_candidate
        Called from this thread with each accepted candidate and the best one so far.
    should_stop
        Polled often; once true, the search ends with its best design.
    checkpoint
        File to keep the search in; removed when a design is proved.
    resume
        Go on from ``checkpoint``: the result is that of an unbroken search.

    Raises
    ------
    InputError
        For settings, a specification or a checkpoint that cannot be used.
    """
    problem = design_problem(task, spec, settings)
    file = None if checkpoint is None else CheckpointFile(checkpoint, problem)
    search = ChainSearch(problem, on_candidate, should_stop, file)
    if resume and file is not None:
        search.take_up(file.read())
    warm_up(problem)
    workers = open_workers(problem)
    try:
        result = search.run(workers)
    finally:
        workers.close()
    if problem.settings.shorten and result.proved:
        left = problem.settings.time_budget - result.elapsed
        result = shorten(problem, result, should_stop, left)
    return result
