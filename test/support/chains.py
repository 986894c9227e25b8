"""Random chains, and the robot descriptions that the example-robot-data package brings."""

from __future__ import annotations

import numpy as np

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.joint import Axis, Joint

_ROBOTS = 'package://example-robot-data/robots/'

# name: (URDF, base, tip, joints)
REAL_ARMS = {
    'panda': (_ROBOTS + 'panda_description/urdf/panda.urdf', 'panda_link0', 'panda_link8', 7),
    'ur3': (_ROBOTS + 'ur_description/urdf/ur3_robot.urdf', 'base_link', 'tool0', 6),
    'ur5': (_ROBOTS + 'ur_description/urdf/ur5_robot.urdf', 'base_link', 'tool0', 6),
    'ur10': (_ROBOTS + 'ur_description/urdf/ur10_robot.urdf', 'base_link', 'tool0', 6),
    'xarm7': (_ROBOTS + 'xarm_description/urdf/xarm7.urdf', 'link_base', 'link7', 7),
    'jaco': (
        _ROBOTS + 'kinova_description/robots/kinova.urdf',
        'j2s6s200_link_base',
        'j2s6s200_end_effector',
        6,
    ),
    'z1': (_ROBOTS + 'z1_description/urdf/z1.urdf', 'link00', 'link06', 6),
    'so101': (
        _ROBOTS + 'so_arm_description/urdf/so101.urdf',
        'base_link',
        'gripper_frame_link',
        5,
    ),
    'baxter': (_ROBOTS + 'baxter_description/urdf/baxter.urdf', 'base', 'left_gripper', 7),
    'talos': (
        _ROBOTS + 'talos_data/robots/talos_full_v2.urdf',
        'torso_2_link',
        'gripper_left_base_link',
        7,
    ),
    'tiago': (
        _ROBOTS + 'tiago_description/robots/tiago_no_hand.urdf',
        'base_link',
        'arm_tool_link',
        8,
    ),
}


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    """Rotation matrix, uniform; now and then one of those with parallel or opposite z axes."""
    choice = rng.integers(8)
    if choice == 0:
        return np.eye(3)
    if choice == 1:
        return np.diag([1.0, -1.0, -1.0])
    x, y, z, w = rng.normal(size=4)
    if choice == 2:
        # A turn about z with a tilt far below any tolerance.
        x, y = 1e-9 * x, 1e-9 * y
    norm = np.sqrt(x * x + y * y + z * z + w * w)
    x, y, z, w = x / norm, y / norm, z / norm, w / norm
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def random_chain(
    rng: np.random.Generator, joints: int | None = None, sliding: float = 0.3
) -> SerialChain:
    """Chain of 1 to 9 joints, part of them prismatic, some with a full turn."""
    n = int(rng.integers(1, 10)) if joints is None else joints
    made = []
    for i in range(n):
        if rng.random() < sliding:
            made.append(Joint(f'joint_{i}', -rng.uniform(0.1, 1.0), 1.0, prismatic=True))
        elif rng.random() < 0.3:
            made.append(Joint(f'joint_{i}'))
        else:
            made.append(Joint(f'joint_{i}', -rng.uniform(0.5, 3.1), rng.uniform(0.5, 3.1)))
    return SerialChain(
        'random',
        tuple(made),
        np.array([random_rotation(rng) for _ in range(n + 1)]),
        rng.normal(scale=0.5, size=(n + 1, 3)),
    )


def coupled_chain(rng: np.random.Generator, joints: int, followers: int) -> SerialChain:
    """Random chain with axes put in that follow its joints, named ``i_of_JOINT``."""
    chain = random_chain(rng, joints, sliding=0.2)
    axes = list(chain.axes)
    for i in range(followers):
        k = int(rng.integers(joints))
        ratio = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 1.5))
        axis = Axis(f'{i}_of_{chain.joint_names[k]}', k, ratio, bool(rng.random() < 0.2))
        axes.insert(int(rng.integers(len(axes) + 1)), axis)
    return SerialChain(
        'coupled',
        chain.joints,
        np.array([random_rotation(rng) for _ in range(len(axes) + 1)]),
        rng.normal(scale=0.5, size=(len(axes) + 1, 3)),
        driven=tuple(axes),
    )


def random_posture(chain: SerialChain, rng: np.random.Generator) -> np.ndarray:
    """Posture inside the limits."""
    return rng.uniform(chain.lower, chain.upper)
