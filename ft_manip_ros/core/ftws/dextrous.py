"""The dextrous FTWS: one position in every orientation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.ftws.effort import MEMBER, NON_MEMBER, UNDECIDED, Effort
from ft_manip_ros.core.ftws.engine import run_engine
from ft_manip_ros.core.ftws.problem import Problem
from ft_manip_ros.core.goal import quaternion_from_rotation
from ft_manip_ros.core.kinematics import fk

# Orientations judged as evidence where all of them cannot be covered.
SAMPLES = 24
_FIRST_ARCS = 16
_NARROWEST = np.pi / 512.0


@dataclass(frozen=True)
class DextrousAnswer:
    """Raw verdict of `judge`, its words, and for a non-member what loses it."""

    code: int
    reason: str
    combo: int = -1
    angles: tuple[float, ...] = ()
    residual: float = 0.0


def judge_dextrous(problem: Problem, goal: Array, effort: Effort) -> DextrousAnswer:
    """Judge a position (row (7,), orientation ignored) in every orientation.

    One refuted orientation refutes the point. The circle of orientations of a planar arm is
    covered by arcs: turning the goal by psi moves the orientation error by at most psi, so an
    arc is a ball of goals. Over SO(3) a fixed sample is judged, which is evidence, not proof.
    """
    effort = effort._replace(intervals=False)
    if problem.plane is not None:
        return _cover_circle(problem, goal, effort)
    rng = np.random.default_rng(effort.seed)
    proved = 0
    for _ in range(SAMPLES):
        row = goal.copy()
        quaternion = rng.normal(size=4)
        row[3:] = quaternion / np.linalg.norm(quaternion)
        judged = run_engine(problem, row[None], effort)
        if judged.verdicts[0] == NON_MEMBER:
            return _lost(problem, row, judged.combo_of[0], judged.witness[0], judged.residuals[0])
        proved += int(judged.verdicts[0] == MEMBER)
    return DextrousAnswer(
        UNDECIDED,
        f'sampled evidence, not a proof: {proved} of {SAMPLES} random orientations were proved '
        'members and none was refuted',
    )


def _lost(
    problem: Problem, row: Array, combo: int, angles: Array, residual: float
) -> DextrousAnswer:
    x, y, z, w = *row[4:], row[3]
    return DextrousAnswer(
        NON_MEMBER,
        f'refuted in the orientation [qx, qy, qz, qw] = [{x:.6f}, {y:.6f}, {z:.6f}, {w:.6f}]',
        int(combo),
        tuple(float(angle) for angle in angles),
        float(residual),
    )


def _cover_circle(problem: Problem, goal: Array, effort: Effort) -> DextrousAnswer:
    """Cover the orientations of a planar arm with arcs, halving those that are not proved."""
    assert problem.plane is not None
    start = fk(problem.chain, np.zeros(problem.chain.n))[0]
    half = np.pi / _FIRST_ARCS
    arcs = [(-np.pi + (2 * i + 1) * half, half) for i in range(_FIRST_ARCS)]
    while arcs:
        middle, half = arcs.pop()
        row = goal.copy()
        row[3:] = np.roll(quaternion_from_rotation(_turn(problem.plane.normal, middle) @ start), 1)
        radius = float(np.hypot(effort.radius, problem.task.length * half * (1.0 + 1e-9)))
        ball = effort._replace(radius=radius, smallest_gap=0.02, boxes=1, pieces=4000)
        if run_engine(problem, row[None], ball).verdicts[0] == MEMBER:
            continue
        judged = run_engine(problem, row[None], effort)
        if judged.verdicts[0] == NON_MEMBER:
            return _lost(problem, row, judged.combo_of[0], judged.witness[0], judged.residuals[0])
        if half < _NARROWEST:
            return DextrousAnswer(UNDECIDED, f'not covered around the orientation {middle:.4f}')
        arcs += [(middle - 0.5 * half, 0.5 * half), (middle + 0.5 * half, 0.5 * half)]
    return DextrousAnswer(MEMBER, 'covered: a posture exists in every orientation')


def _turn(axis: Array, angle: float) -> Array:
    """Rotation matrix (3, 3) about a unit axis."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: Array = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return turned
