"""Design tasks, candidates and results as messages, and back."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from std_msgs.msg import Header

from ft_manip_interfaces.action import DesignArm
from ft_manip_interfaces.msg import DesignCandidate, TaskRegion
from ft_manip_ros.core.design.candidate import Candidate, DesignResult
from ft_manip_ros.core.design.job import DesignJob
from ft_manip_ros.core.design.problem import DesignProblem, design_problem
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import DesignSpec, Goal, Task
from ft_manip_ros.core.region import Box, Region, Sphere
from ft_manip_ros.nodes.conversions import (
    dh_to_message,
    goal_from_message,
    stamp,
    task_from_message,
)
from ft_manip_ros.nodes.design_parameters import joint_limits


@dataclass(frozen=True)
class Request:
    """A checked question to the designer, and the problem that its tables belong to."""

    task: Task
    spec: DesignSpec
    settings: DesignSettings
    problem: DesignProblem


def make_request(task: Task, spec: DesignSpec, settings: DesignSettings) -> Request:
    """Check a task, specification and settings; raises `InputError`."""
    return Request(task, spec, settings, design_problem(task, spec, settings))


def request_from_goal(goal: DesignArm.Goal, defaults: DesignSettings) -> Request:
    """Question of an action goal; what it leaves empty comes from ``defaults``.

    Raises
    ------
    InputError
        Naming the field of the goal.
    """
    limits = list(goal.joint_limits) or [float(goal.lower), float(goal.upper)]
    if limits == [0.0, 0.0]:
        limits = [-np.pi, np.pi]
    regions = [region_from_message(region, i) for i, region in enumerate(goal.regions)]
    points = task_from_message(goal.task).goals if goal.task.goals or not regions else ()
    task = Task(goal.task.name, (*points, *regions))
    dof = int(goal.dof)
    spec = DesignSpec(
        **{'dof': dof, 'order': int(goal.order) or 1, **joint_limits(limits, dof, 'joint_limits')}
    )
    if not (np.isfinite(goal.time_budget) and goal.time_budget >= 0.0):
        raise InputError('time_budget', f'is {goal.time_budget}; must be >= 0 s (0: the default)')
    settings = replace(
        defaults,
        seed=int(goal.seed),
        time_budget=float(goal.time_budget) or defaults.time_budget,
        method=goal.method or defaults.method,
    )
    return make_request(task, spec, settings)


def region_from_message(message: TaskRegion, index: int) -> Goal:
    """Volume of points of a message, as a goal at its centre; raises `InputError`."""
    goal = goal_from_message(message.goal, f'region_{index + 1}')
    region: Region
    if message.shape == TaskRegion.BOX:
        region = Box((message.size.x, message.size.y, message.size.z))
    elif message.shape == TaskRegion.SPHERE:
        region = Sphere(message.radius)
    else:
        raise InputError(f'region {goal.id!r}: shape', f'is {message.shape}; must be 0 or 1')
    return replace(goal, region=region)


def candidate_to_message(
    request: Request, candidate: Candidate, status: int, reason: str, header: Header
) -> DesignCandidate:
    """One accepted candidate."""
    return DesignCandidate(
        header=header,
        task=request.task.name,
        status=status,
        reason=reason,
        design=dh_to_message(request.problem.table(candidate.parameters)),
        order=request.spec.order,
        seed=request.settings.seed,
        iteration=candidate.iteration,
        penalty=candidate.penalty,
        goal_penalties=list(candidate.goal_penalties),
        temperature=candidate.temperature,
        acceptance_rate=candidate.acceptance_rate,
    )


def result_to_message(request: Request, result: DesignResult, header: Header) -> DesignCandidate:
    """Best design at the end, with whether it is proved."""
    status = DesignCandidate.FINAL_PROVED if result.proved else DesignCandidate.FINAL_UNPROVED
    return DesignCandidate(
        header=header,
        task=request.task.name,
        status=status,
        reason=result.reason,
        design=dh_to_message(result.table),
        order=request.spec.order,
        seed=request.settings.seed,
        iteration=result.iterations,
        penalty=result.penalty,
        goal_penalties=list(result.goal_penalties),
    )


def feedback(job: DesignJob) -> DesignArm.Feedback:
    """Progress of a running search."""
    message = DesignArm.Feedback()
    if job.latest is not None and job.best is not None:
        message.iteration = job.latest.iteration
        message.temperature = job.latest.temperature
        message.penalty = job.latest.penalty
        message.best_penalty = job.best.penalty
        message.acceptance_rate = job.latest.acceptance_rate
    message.elapsed = job.elapsed
    message.remaining = max(job.settings.time_budget - job.elapsed, 0.0)
    message.eta = min(job.eta(), message.remaining)
    return message


def make_header(ns: int, frame: str) -> Header:
    """Header with the stamp ``ns`` (nanoseconds since the epoch) in ``frame``."""
    return Header(stamp=stamp(ns), frame_id=frame)
