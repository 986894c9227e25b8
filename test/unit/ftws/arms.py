"""Arms of the paper, as the tests of the FTWS need them."""

from __future__ import annotations

import numpy as np

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.dh import DhTable
from ft_manip_ros.core.joint import Joint


def dh_arm(d, a, alpha, limit=np.pi) -> SerialChain:
    joints = tuple(Joint(f'joint_{i + 1}', -limit, limit) for i in range(len(d)))
    return DhTable(
        'arm',
        joints,
        np.array(d, float),
        np.array(a, float),
        np.array(alpha, float),
        np.zeros(len(d)),
    ).chain()


def table_1(a=0.5, b=0.3, scale=1.0, limit_deg=180.0) -> SerialChain:
    """Table 1: FTWS is rho <= 2 and (rho - 1)^2 + z^2 <= 4 times the scale, without limits."""
    return dh_arm(
        np.array([0.0, a, -a, b, -b]) * scale,
        np.ones(5) * scale,
        [np.pi / 2, 0.0, np.pi / 2, 0.0, 0.0],
        np.radians(limit_deg),
    )


def table_1_distance(points, scale=1.0):
    """Negative inside Table 1's FTWS, positive outside: a lower bound of the distance (m)."""
    rho, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    return np.maximum(rho - 2.0 * scale, np.hypot(rho - scale, z) - 2.0 * scale)


def planar(*lengths: float, limit=np.pi) -> SerialChain:
    n = len(lengths)
    return dh_arm(np.zeros(n), lengths, np.zeros(n), limit)
