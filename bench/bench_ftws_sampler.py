"""FTWS verdicts on 500 random arms against an independent sampler: SciPy, plain NumPy."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from bench.ftws_arms import random_arm
from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.dh import DhTable
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import Verdict

VERDICT = FtwsSettings(intervals=False)


def run(arms: int = 500, angles: int = 5) -> None:
    """Random arms against SciPy on plain NumPy kinematics: members sampled, witnesses tried."""
    rng = np.random.default_rng(3)
    contradictions = unconfirmed = 0
    count = dict.fromkeys(Verdict, 0)
    for _ in range(arms):
        table = random_arm(rng, int(rng.integers(3, 8)))
        point = rng.normal(size=3)
        point *= rng.uniform(0.1, 0.5) * table.a.sum() / np.linalg.norm(point)
        answer = query(table.chain(), point[None], settings=VERDICT)[0]
        count[answer.verdict] += 1
        if answer.verdict is Verdict.NON_MEMBER:
            joint = table.chain().index(answer.joints[0])
            miss = _closest(table, point, joint, answer.angles[0], 6, rng, stop=0.0)
            contradictions += miss < answer.residual - 1e-9
        elif answer.verdict is Verdict.MEMBER:
            for joint, limit in enumerate(table.joints):
                for angle in np.linspace(limit.lower, limit.upper, angles):
                    miss = _closest(table, point, joint, float(angle), 30, rng, stop=1e-5)
                    unconfirmed += miss > 1e-5
    print(
        f'{arms} random arms of 3 to 7 joints: {count[Verdict.MEMBER]} members, '
        f'{count[Verdict.NON_MEMBER]} non-members, {count[Verdict.UNDECIDED]} undecided; SciPy '
        f'gets nearer than proved at {contradictions} witnesses and finds no posture at '
        f'{unconfirmed} frozen angles of members',
        flush=True,
    )


def _closest(
    table: DhTable,
    point: Array,
    frozen: int,
    angle: float,
    starts: int,
    rng: np.random.Generator,
    stop: float,
) -> float:
    """Smallest miss (m) that SciPy finds with one joint frozen."""
    lower = np.array([joint.lower for joint in table.joints])
    upper = np.array([joint.upper for joint in table.joints])
    free = [j for j in range(len(lower)) if j != frozen]
    q = np.zeros(len(lower))
    q[frozen] = angle

    def miss(x: Array) -> Array:
        q[free] = x
        return _tool(table, q) - point

    best = np.inf
    for _ in range(starts):
        start = rng.uniform(lower[free], upper[free])
        found = least_squares(miss, start, bounds=(lower[free], upper[free]), xtol=1e-12)
        best = min(best, float(np.linalg.norm(found.fun)))
        if best < stop:
            break
    return best


def _tool(table: DhTable, q: Array) -> Array:
    """Tool position by products of DH matrices, written apart from the package."""
    p = np.zeros(3)
    for d, a, alpha, angle in zip(
        table.d[::-1], table.a[::-1], table.alpha[::-1], q[::-1], strict=True
    ):
        x, y, z = p[0] + a, p[1], p[2]
        y, z = np.cos(alpha) * y - np.sin(alpha) * z, np.sin(alpha) * y + np.cos(alpha) * z
        z += d
        p = np.array(
            [np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y, z]
        )
    return p
