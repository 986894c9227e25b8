"""Critical value manifolds of spatial positional arms with revolute joints (section 3.2).

At a singular posture one line through the end effector meets every joint axis. So singular
postures can be built from the tool backwards: in the last link, the line lies in the plane of
the tool and the last axis, at one free angle; each joint before must turn such that the line
meets the axis before it, which is ``a cos + b sin + c = 0`` with up to two solutions. The first
joint is free and sweeps a surface of revolution: its profile is what is computed here.
"""

from __future__ import annotations

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError

# Moments below this (m) everywhere mean that a line is parallel to the next axis.
_PARALLEL = 1e-6


def critical_values(chain: SerialChain, samples: int = 4001) -> tuple[Array, Array]:
    """Points of the critical value manifolds in the half plane of the first axis.

    Limits are not considered.

    Parameters
    ----------
    samples
        Directions of the line through the tool.

    Returns
    -------
    points : ndarray, shape (N, 2)
        Radius about and height along the first joint's axis (m).
    postures : ndarray, shape (N, n)
        The singular postures, with the first joint at 0.

    Raises
    ------
    InputError
        For arms with slides or fewer than three joints.
    """
    n = chain.n
    if n < 3 or any(joint.prismatic for joint in chain.joints):
        raise InputError(chain.name, 'has slides or too few joints; three or more hinges needed')
    angle = np.linspace(0.0, np.pi, samples)
    p = np.broadcast_to(chain.translations[n], (samples, 3)).copy()
    radial = np.array([p[0, 0], p[0, 1], 0.0])
    size = np.linalg.norm(radial)
    radial = radial / size if size > 1e-12 else np.array([1.0, 0.0, 0.0])
    u = np.cos(angle)[:, None] * np.array([0.0, 0.0, 1.0]) + np.sin(angle)[:, None] * radial
    q = np.zeros((samples, n))
    for i in range(n - 1, 0, -1):
        rotation, offset = chain.rotations[i], chain.translations[i]
        # Moment of the line about the axis before, for three turns of joint i.
        moments = []
        for turn in (0.0, 0.5 * np.pi, np.pi):
            moved_p, moved_u = _carry(p, u, np.full(len(p), turn), rotation, offset)
            moments.append(moved_p[:, 0] * moved_u[:, 1] - moved_p[:, 1] * moved_u[:, 0])
        constant = 0.5 * (moments[0] + moments[2])
        cosine, sine = moments[0] - constant, moments[1] - constant
        amplitude = np.hypot(cosine, sine)
        parts = []
        # Lines parallel to both axes meet the one before at infinity, however the joint turns.
        always = amplitude + np.abs(constant) < _PARALLEL * (1.0 + np.linalg.norm(p, axis=1))
        if always.any():
            # Quarter turns have to be among them: there lines become parallel to axes.
            turns = np.linspace(-np.pi, np.pi, 4 * (samples // 40 + 1) + 1)[:-1]
            count = int(always.sum())
            theta = np.tile(turns, count)
            free_q = np.repeat(q[always], len(turns), axis=0)
            free_q[:, i] = theta
            parts.append(
                (
                    *_carry(
                        np.repeat(p[always], len(turns), axis=0),
                        np.repeat(u[always], len(turns), axis=0),
                        theta,
                        rotation,
                        offset,
                    ),
                    free_q,
                )
            )
        solvable = (np.abs(constant) <= amplitude * (1.0 + 1e-12)) & ~always
        p, u, q = p[solvable], u[solvable], q[solvable]
        base = np.arctan2(sine, cosine)[solvable]
        amplitude = np.maximum(amplitude[solvable], 1e-300)
        spread = np.arccos(np.clip(-constant[solvable] / amplitude, -1.0, 1.0))
        for theta in (base + spread, base - spread):
            turned_p, turned_u = _carry(p, u, theta, rotation, offset)
            turned_q = q.copy()
            turned_q[:, i] = (theta + np.pi) % (2.0 * np.pi) - np.pi
            parts.append((turned_p, turned_u, turned_q))
        p, u, q = (np.concatenate(pair) for pair in zip(*parts, strict=True))
    return np.stack([np.hypot(p[:, 0], p[:, 1]), p[:, 2]], axis=1), q


def _carry(
    p: Array, u: Array, theta: Array, rotation: Array, offset: Array
) -> tuple[Array, Array]:
    """Turn points and directions (N, 3) about z and express them one joint further down."""
    c, s = np.cos(theta), np.sin(theta)
    turned = [
        np.stack([c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1], v[:, 2]], axis=1)
        for v in (p, u)
    ]
    return turned[0] @ rotation.T + offset, turned[1] @ rotation.T
