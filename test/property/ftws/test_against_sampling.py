"""Verdicts against an independent sampler on random arms: SciPy and plain NumPy kinematics."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from ft_manip_ros.core.dh import DhTable
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import Verdict
from ft_manip_ros.core.joint import Joint
from support.dense_reach import dh_frame, worst_miss


def random_arm(rng, n):
    d = rng.uniform(-0.3, 0.3, n)
    a = rng.uniform(0.2, 1.0, n)
    alpha = rng.choice([0.0, np.pi / 2, -np.pi / 2, 1.0], n)
    limit = rng.choice([np.pi, np.radians(170.0), np.radians(120.0)], n)
    lower, upper = -limit, limit * rng.uniform(0.7, 1.0, n)
    upper = np.where(limit == np.pi, np.pi, upper)
    joints = tuple(Joint(f'joint_{i + 1}', float(lower[i]), float(upper[i])) for i in range(n))
    chain = DhTable('random', joints, d, a, alpha, np.zeros(n)).chain()
    return chain, (d, a, alpha, lower, upper)


def closest(tables, point, frozen, angle, starts, seed):
    """Smallest miss (m) that SciPy finds with one joint frozen."""
    d, a, alpha, lower, upper = tables
    free = [j for j in range(len(d)) if j != frozen]
    rng = np.random.default_rng(seed)
    best = np.inf
    for _ in range(starts):

        def miss(x):
            q = np.zeros(len(d))
            q[frozen], q[free] = angle, x
            return dh_frame(d, a, alpha, q)[:3, 3] - point

        found = least_squares(
            miss, rng.uniform(lower[free], upper[free]), bounds=(lower[free], upper[free])
        )
        best = min(best, float(np.linalg.norm(found.fun)))
    return best


@pytest.mark.parametrize('n', [3, 4, 5, 6, 7])
def test_no_verdict_contradicts_the_sampler(n):
    rng = np.random.default_rng(100 + n)
    settings = FtwsSettings(intervals=False)
    answers = []
    for arm in range(3):
        chain, tables = random_arm(rng, n)
        scale = tables[1].sum()
        points = rng.normal(size=(3, 3))
        points *= (rng.uniform(0.1, 0.5, 3) * scale / np.linalg.norm(points, axis=1))[:, None]
        for point, answer in zip(points, query(chain, points, settings=settings), strict=True):
            answers.append(answer.verdict)
            if answer.verdict is Verdict.MEMBER:
                worst, where = worst_miss(*tables, point, angles=3, starts=40, seed=arm)
                assert worst < 1e-5, (where, point)
            elif answer.verdict is Verdict.NON_MEMBER:
                frozen = chain.index(answer.joints[0])
                best = closest(tables, point, frozen, answer.angles[0], 8, arm)
                assert best >= answer.residual - 1e-9, (answer, point)
    # A random arm seldom has members, but the engine has to decide nearly always.
    assert answers.count(Verdict.UNDECIDED) <= 2
