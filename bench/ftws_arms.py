"""Arms that the FTWS benchmarks share: families of one shape, limited ones, random ones."""

from __future__ import annotations

import numpy as np

from ft_manip_ros.core.arm_file import load_dh
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.dh import DhTable
from ft_manip_ros.core.joint import Joint


def limited(arm: str, degrees: float) -> SerialChain:
    """Arm file with the same symmetric limits for all joints."""
    table = load_dh(arm)
    limit = np.radians(degrees)
    joints = tuple(Joint(joint.name, -limit, limit) for joint in table.joints)
    return type(table)(
        f'{table.name} at {degrees:g} deg', joints, table.d, table.a, table.alpha, table.offset
    ).chain()


def planar(*lengths: float) -> SerialChain:
    """Planar arm without limits."""
    n = len(lengths)
    joints = tuple(Joint(f'joint_{i + 1}') for i in range(n))
    zero = np.zeros(n)
    return DhTable(f'planar {n}R', joints, zero, np.array(lengths), zero, zero).chain()


def spatial(n: int) -> SerialChain:
    """Table 1 continued: alternating pairs of parallel axes, unit links."""
    joints = tuple(Joint(f'joint_{i + 1}') for i in range(n))
    alpha = np.array([np.pi / 2 if i % 2 == 0 else 0.0 for i in range(n)])
    return DhTable(f'spatial {n}R', joints, np.zeros(n), np.ones(n), alpha, np.zeros(n)).chain()


def random_arm(rng: np.random.Generator, n: int) -> DhTable:
    """DH arm of n hinges: lengths, offsets, twists and limits at random, some without limits."""
    d = rng.uniform(-0.3, 0.3, n)
    a = rng.uniform(0.2, 1.0, n)
    alpha = rng.choice([0.0, np.pi / 2, -np.pi / 2, 1.0], n)
    limit = rng.choice([np.pi, np.radians(170.0), np.radians(120.0)], n)
    lower, upper = -limit, limit * rng.uniform(0.7, 1.0, n)
    upper = np.where(limit == np.pi, np.pi, upper)
    joints = tuple(Joint(f'joint_{i + 1}', float(lower[i]), float(upper[i])) for i in range(n))
    return DhTable('random', joints, d, a, alpha, np.zeros(n))
