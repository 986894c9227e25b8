"""How far a posture misses a goal, how uncertain its tool is, and how much room it leaves."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.kinematics import fk, jacobian

# Share of the largest singular value of a Jacobian below which it counts as singular.
_SINGULAR = 1e-9


def tool_errors(chain: SerialChain, q: Array, goal: Goal) -> tuple[float, float]:
    """Distance (m) and angle (rad) between the tool at posture ``q``, (n,), and a goal.

    The angle is that between the z axes where the goal leaves the roll free, and NaN where it
    has no orientation.
    """
    return frame_errors(*fk(chain, q), goal)


def frame_errors(rotation: Array, position: Array, goal: Goal) -> tuple[float, float]:
    """As `tool_errors`, from the tool's rotation, (3, 3), and position, (3,)."""
    distance = math.dist(position.tolist(), goal.position.tolist())
    if goal.orientation is None:
        return distance, math.nan
    if goal.free_axis:
        a, b = rotation[:, 2], goal.orientation[:, 2]
        return distance, float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
    turn = goal.orientation @ rotation.T
    skew = 0.5 * (turn - turn.T)
    sine = math.hypot(skew[2, 1], skew[0, 2], skew[1, 0])
    return distance, math.atan2(sine, 0.5 * (np.trace(turn) - 1.0))


def tool_uncertainties(chain: SerialChain, qs: Array, sigma: Mapping[str, float]) -> Array:
    """Standard deviations (m) of the tool position that the frozen joints' sigmas cause.

    One for each of the postures ``qs``, (K, n).
    """
    if not any(sigma.values()):
        return np.zeros(len(qs))
    columns = [chain.index(name) for name in sigma]
    moves = jacobian(chain, qs)[:, :3, columns] * np.array(list(sigma.values()))
    return np.asarray(np.sqrt(np.sum(moves**2, axis=(1, 2))))


def posture_margins(chain: SerialChain, qs: Array, frozen: Collection[str]) -> Array:
    """Distances (m) that the tool could move any way before a healthy joint meets its limit.

    To first order, by the smallest joint motion; 0 at a singular posture. One for each of the
    postures ``qs``, (K, n).
    """
    healthy = [i for i, name in enumerate(chain.joint_names) if name not in frozen]
    moves = jacobian(chain, qs)[:, :3, healthy]
    _, sizes, directions = np.linalg.svd(moves, full_matrices=False)
    if sizes.shape[1] < 3:
        return np.zeros(len(qs))
    singular = sizes[:, 2] <= _SINGULAR * np.maximum(sizes[:, 0], 1.0)
    # Rows of the pseudo-inverse: what each joint does for a metre of tool motion.
    sizes = np.where(singular[:, None], 1.0, sizes)
    effort = np.linalg.norm(directions / sizes[:, :, None], axis=1)
    slack = np.maximum(np.minimum(qs - chain.lower, chain.upper - qs)[:, healthy], 0.0)
    slack[:, chain.arrays.wraps[healthy]] = np.inf
    margins = np.min(slack / np.maximum(effort, 1e-12), axis=1)
    return np.asarray(np.where(singular, 0.0, margins))
