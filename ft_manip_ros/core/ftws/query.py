"""Queries: is a goal reachable whichever joints fail, at whichever angles."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.dextrous import judge_dextrous
from ft_manip_ros.core.ftws.effort import MEMBER, NON_MEMBER, Effort
from ft_manip_ros.core.ftws.engine import run_engine
from ft_manip_ros.core.ftws.planar_verdict import closed_form, judge_planar
from ft_manip_ros.core.ftws.problem import Problem, goal_rows, prepare
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import FtwsResult, Verdict
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.kinematics import fk

_NO_PIECES = np.zeros((0, 0))
# Intervals closer than this are one (rad or m).
_TOUCHING = 1e-9
# Balls of goals around a member: the largest tried, by the task's length, and how often halved.
_LARGEST_BALL = 0.2
_BALLS = 16


def query(
    chain: SerialChain,
    goals: Sequence[Goal] | Array,
    *,
    order: int = 1,
    mode: str = 'position',
    settings: FtwsSettings | None = None,
    threads: int = 1,
) -> list[FtwsResult]:
    """Judge goals against the fault-tolerant work space of an arm.

    Parameters
    ----------
    chain
        The arm, whole. Joints freeze within their operating limits; the others then use their
        physical limits.
    goals : sequence of Goal, or ndarray (N, 3) or (N, 7)
        Positions (m), or positions and quaternions [qx, qy, qz, qw], in the base frame.
    order
        How many joints fail at once, k >= 1.
    mode
        ``'position'``, ``'pose'`` or ``'dextrous'`` (position in every orientation).
    threads
        Goals are shared among this many threads; the answers do not depend on it.

    Returns
    -------
    list of FtwsResult
        One per goal, in order.

    Raises
    ------
    InputError
        For malformed goals, an unknown mode or an impossible order.
    """
    settings = settings or FtwsSettings()
    if threads < 1:
        raise InputError('threads', f'is {threads}; must be at least 1')
    rows, free = goal_rows(goals, mode)
    problems = {
        flag: prepare(chain, mode, order, free_axis=flag) for flag in sorted(set(free.tolist()))
    } or {False: prepare(chain, mode, order)}
    deadline = time.perf_counter() + settings.time_budget if settings.time_budget else np.inf

    def ask(i: int) -> FtwsResult:
        if time.perf_counter() > deadline:
            x, y, z = rows[i, :3].tolist()
            return FtwsResult((x, y, z), Verdict.UNDECIDED, 'the time budget was spent before it')
        return judge_one(problems[bool(free[i])], rows[i], settings)

    if threads == 1 or len(rows) < 2:
        return [ask(i) for i in range(len(rows))]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(ask, range(len(rows))))


def warm_up(chain: SerialChain, *, order: int = 1, mode: str = 'position') -> None:
    """Compile (or load) the kernels for an arm, so that no callback has to wait for it."""
    problem = prepare(chain, mode, order)
    goal = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    judge_one(problem, goal, FtwsSettings(restarts=1, boxes=1, pieces=1))


def judge_one(
    problem: Problem, goal: Array, settings: FtwsSettings, pieces: Array | None = None
) -> FtwsResult:
    """Judge one goal row (7,) of a prepared problem; ``pieces`` receives the certificate."""
    started = time.perf_counter()
    x, y, z = goal[:3].tolist()
    off = distance_off_plane(problem, goal)
    if off > settings.tolerance + settings.radius:
        first = problem.combos[0]
        return FtwsResult(
            (x, y, z),
            Verdict.NON_MEMBER,
            'the goal is off the plane of this planar arm',
            tuple(problem.chain.joint_names[j] for j in first),
            tuple(float(problem.ranges[:, j].mean()) for j in first),
            residual=off,
            margin=off - settings.tolerance,
            tolerated={name: [] for name in failing(problem)} if problem.order == 1 else {},
            surviving_fraction=dict.fromkeys(failing(problem), 0.0) if problem.order == 1 else {},
            elapsed_s=time.perf_counter() - started,
        )
    combos, k = problem.combos, problem.order
    effort = settings.effort(problem.oriented, problem.task.length)
    if off > effort.tolerance and (k == 1 or problem.mode == 'dextrous'):
        # What is proved of a disc in the plane is not true of the ball.
        return FtwsResult(
            (x, y, z),
            Verdict.UNDECIDED,
            f"the ball's centre is {off:.3g} m off the plane of this planar arm: its own verdict "
            'is non_member, that of the rest was not asked for',
            residual=off,
            elapsed_s=time.perf_counter() - started,
        )
    if problem.mode == 'dextrous':
        return _judge_dextrous(problem, goal, settings, started)
    if k > 1 and problem.form is not None:
        result = closed_form(problem, problem.form, goal, off, effort)
        if result.verdict is not Verdict.UNDECIDED or problem.closed:
            return replace(result, elapsed_s=time.perf_counter() - started)
    judged = run_engine(problem, goal[None], effort, _NO_PIECES if pieces is None else pieces)
    code, at = int(judged.verdicts[0]), int(judged.combo_of[0])
    margin, residual = 0.0, float(judged.residuals[0])
    joints: tuple[str, ...] = ()
    angles: tuple[float, ...] = ()
    if at >= 0:
        joints = tuple(problem.chain.joint_names[j] for j in combos[at])
        angles = tuple(judged.witness[0].tolist())
    if code == MEMBER:
        verdict = Verdict.MEMBER
        reason = f'covered: a posture exists for every position of any {k} failed joint(s)'
        residual = 0.0
        margin = settings.radius
        if settings.margin and problem.form is not None:
            answer = judge_planar(
                problem.form, goal, off, effort.tolerance, effort.radius, problem.ranges
            )
            margin = max(answer.margin, settings.radius)
        elif settings.margin:
            margin = proved_ball(problem, goal, effort)
    elif code == NON_MEMBER:
        verdict = Verdict.NON_MEMBER
        reason = f'refuted: no posture comes within {residual:.3g} m with these joints frozen'
        margin = max(residual - settings.tolerance, 0.0)
    else:
        verdict = Verdict.UNDECIDED
        reason = 'neither covered nor refuted within the budget'
    tolerated: dict[str, list[tuple[float, float]]] = {}
    surviving: dict[str, float] = {}
    if k == 1 and (settings.intervals or code == MEMBER):
        for c, joint in enumerate(combos[:, 0]):
            name = problem.chain.joint_names[joint]
            merged = merge_intervals(judged.covered[0, c, : judged.covered_count[0, c]])
            # Slivers at the ends of an interval say nothing that its end does not.
            merged = [(a, b) for a, b in merged if b - a > settings.smallest_gap]
            width = float(problem.ranges[1, joint] - problem.ranges[0, joint])
            tolerated[name] = merged
            # The parts touch to rounding; a joint that cannot move survives or not as a whole.
            total = sum(b - a for a, b in merged)
            surviving[name] = min(total / width, 1.0) if width > 0.0 else float(bool(merged))
    return FtwsResult(
        (x, y, z), verdict, reason, joints, angles, residual, margin, tolerated, surviving,
        time.perf_counter() - started,
    )  # fmt: skip


def _judge_dextrous(
    problem: Problem, goal: Array, settings: FtwsSettings, started: float
) -> FtwsResult:
    x, y, z = goal[:3].tolist()
    answer = judge_dextrous(problem, goal, settings)
    verdict = {MEMBER: Verdict.MEMBER, NON_MEMBER: Verdict.NON_MEMBER}.get(
        answer.code, Verdict.UNDECIDED
    )
    joints = problem.combos[answer.combo] if answer.combo >= 0 else []
    return FtwsResult(
        (x, y, z),
        verdict,
        answer.reason,
        tuple(problem.chain.joint_names[j] for j in joints),
        answer.angles,
        answer.residual,
        elapsed_s=time.perf_counter() - started,
    )


def proved_ball(problem: Problem, goal: Array, effort: Effort) -> float:
    """Radius (m) of a ball around a member that is proved as a whole; 0 if none was found.

    Balls are tried from large to small, each with one covering of its own.
    """
    radius = _LARGEST_BALL * problem.task.length
    modest = effort._replace(smallest_gap=1e-3, boxes=1, pieces=2000, intervals=False)
    for ball in range(_BALLS):
        # What is left to the last few is near the boundary and takes all the effort.
        judging = modest if ball < _BALLS - 4 else effort._replace(intervals=False)
        if run_engine(problem, goal[None], judging._replace(radius=radius)).verdicts[0] == MEMBER:
            return max(radius, effort.radius)
        radius *= 0.5
    return effort.radius


def failing(problem: Problem) -> list[str]:
    """Names of the joints that may fail."""
    return [problem.chain.joint_names[j] for j in sorted(set(problem.combos.ravel().tolist()))]


def distance_off_plane(problem: Problem, goal: Array) -> float:
    """Distance that no posture of a planar arm can make good (m); 0 for a spatial arm."""
    if problem.plane is None:
        return 0.0
    off = abs(float(problem.plane.normal @ goal[:3]) - problem.plane.height)
    if problem.mode == 'pose':
        w, v = goal[3], goal[4:]
        rotation = fk(problem.chain, np.zeros(problem.chain.n))[0]
        # The goal's tool has to carry the same body axis along the plane's normal.
        body = rotation.T @ problem.plane.normal
        carried = body + 2.0 * np.cross(v, np.cross(v, body) + w * body)
        tilt = float(np.linalg.norm(carried - problem.plane.normal))
        off = float(np.hypot(off, problem.task.length * tilt))
    return off


def merge_intervals(rows: Array) -> list[tuple[float, float]]:
    """Union of intervals (R, 2), sorted."""
    merged: list[tuple[float, float]] = []
    for a, b in sorted((float(a), float(b)) for a, b in rows):
        if merged and a <= merged[-1][1] + _TOUCHING:
            merged[-1] = (merged[-1][0], max(b, merged[-1][1]))
        else:
            merged.append((a, b))
    return merged
