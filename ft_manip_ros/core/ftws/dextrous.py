"""The dextrous FTWS: one position in every orientation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.ftws.directions import ask_directions, prepare_directions
from ft_manip_ros.core.ftws.effort import MEMBER, NON_MEMBER, UNDECIDED, Effort
from ft_manip_ros.core.ftws.engine import run_engine
from ft_manip_ros.core.ftws.problem import Problem, prepare
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.wrist import Wrist, find_wrist
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


def judge_dextrous(problem: Problem, goal: Array, settings: FtwsSettings) -> DextrousAnswer:
    """Judge a position (row (7,), orientation ignored) in every orientation.

    One refuted orientation refutes the point. The circle of orientations of a planar arm is
    covered by arcs: turning the goal by psi moves the orientation error by at most psi, so an
    arc is a ball of goals. Over SO(3), a three-roll wrist leaves the arm without it and a sphere
    of directions to be asked for (`wrist.py`); otherwise a fixed sample of orientations is judged.
    Where none is refuted, that is evidence, not proof.
    """
    effort = settings.effort(True, problem.task.length)._replace(intervals=False)
    if problem.plane is not None:
        return _cover_circle(problem, goal, effort)
    wrist = find_wrist(problem.chain) if problem.order == 1 else None
    if wrist is not None and wrist.arm.n > 1:
        return _point_wrist(problem, wrist, goal, settings)
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


def _point_wrist(
    problem: Problem, wrist: Wrist, goal: Array, settings: FtwsSettings
) -> DextrousAnswer:
    """Ask what `wrist.py` says is left: the position without the wrist, and its directions."""
    single = replace(settings, intervals=False)
    placing = prepare(wrist.arm, 'position', 1)
    judged = run_engine(placing, goal[None], single.effort(False, placing.task.length))
    code, at = int(judged.verdicts[0]), int(judged.combo_of[0])
    if code == NON_MEMBER:
        return DextrousAnswer(
            NON_MEMBER,
            'refuted: out of reach for the wrist, in any orientation',
            _single(problem, int(placing.combos[at, 0])),
            (float(judged.witness[0, 0]),),
            float(judged.residuals[0]),
        )
    if code != MEMBER:
        return DextrousAnswer(UNDECIDED, 'the position of the wrist was neither proved nor lost')
    asked = ask_directions(prepare_directions(wrist.arm), goal[:3], settings)
    if asked.lost is not None and wrist.along:
        angle, way = wrist.along[0]
        row = goal.copy()
        row[3:] = _turn_onto(wrist.axis, way * asked.lost)
        combo = _single(problem, wrist.middle)
        return _lost(problem, row, combo, np.array([angle]), asked.residual)
    if asked.lost is not None:
        return DextrousAnswer(
            UNDECIDED,
            f'{problem.chain.joint_names[wrist.middle]} cannot freeze in line with the forearm, '
            'and the forearm cannot point everywhere: what is left was not decided',
        )
    return DextrousAnswer(
        UNDECIDED,
        'the position is proved for failures before the wrist; that the wrist can be pointed '
        f'anywhere, as its own failures ask for, is sampled evidence, not a proof: {asked.proved} '
        f'of {asked.asked} directions were proved and none was refuted',
    )


def _single(problem: Problem, joint: int) -> int:
    return int(np.flatnonzero(problem.combos[:, 0] == joint)[0])


def _turn_onto(start: Array, end: Array) -> Array:
    """Quaternion (w, x, y, z) of a rotation that takes one unit vector to another."""
    helper = np.eye(3)[int(np.argmin(np.abs(start)))]
    # By way of any vector perpendicular to the first: never the other way round.
    across = np.cross(helper, start) if start @ end < 0.0 else start
    across /= np.linalg.norm(across)
    turn = np.eye(3)
    for a, b in ((start, across), (across, end)):
        # A product of two reflections.
        middle = (a + b) / np.linalg.norm(a + b)
        half = np.eye(3) - 2.0 * np.outer(middle, middle)
        turn = half @ (np.eye(3) - 2.0 * np.outer(a, a)) @ turn
    return np.roll(quaternion_from_rotation(turn), 1)


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
