"""The memory of a fault monitor that has seen nothing yet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from ft_manip_ros.core.detection.layout import (
    ARM,
    CELLS,
    HISTORY,
    JOINT,
    LAGS,
    NO_TIME,
    PAST,
    RING,
    SETTINGS,
    Memory,
)
from ft_manip_ros.core.detection.settings import MonitorSettings
from ft_manip_ros.core.detection.states import JointState
from ft_manip_ros.core.joint import Joint

_MOVING_SPEED = {'revolute': 0.005, 'prismatic': 0.001}  # rad/s, m/s: slower is creep
# Numbers that are not known yet.
_UNKNOWN = (
    'q',
    'v',
    'effort',
    'raw_1',
    'command',
    'command_rest_value',
    'depart_q',
    'prove_q',
    'prove_c',
    'drift_q',
    'frozen_q',
    'frozen_sigma',
)
# Times of what has never happened.
_NEVER = (
    't',
    't_1',
    't_2',
    'last_jerk',
    'command_rest_since',
    'departed',
    'started',
    'pace_t',
    'anchor_t',
    'before_t',
    'came_t',
    'tool_asked',
)


def allocate(
    joints: Sequence[Joint], settings: MonitorSettings, limited: Sequence[bool], exempt: set[str]
) -> Memory:
    """Memory of a monitor that has seen nothing yet.

    Parameters
    ----------
    joints
        The n joints.
    settings
        Thresholds and windows.
    limited
        For each joint, whether its limits and speed are known rather than defaults.
    exempt
        Names of joints that are never LOCKED (grippers).
    """
    n = len(joints)
    records = np.zeros(n, dtype=JOINT)
    for record, joint, known in zip(records, joints, limited, strict=True):
        kind = 'prismatic' if joint.prismatic else 'revolute'
        record['prismatic'] = joint.prismatic
        record['exempt'] = joint.name in exempt
        record['wraps'] = not joint.prismatic and (joint.wraps or not known)
        bounded = known and not joint.wraps
        record['lower'] = joint.lower if bounded else -np.inf
        record['upper'] = joint.upper if bounded else np.inf
        default = getattr(settings, f'default_velocity_{kind}')
        record['velocity_limit'] = joint.velocity if known else default
        record['slack'] = getattr(settings, f'slack_{kind}')
        record['slack_least'] = getattr(settings, f'slack_least_{kind}')
        record['still_least'] = getattr(settings, f'still_{kind}')
        record['runaway_distance'] = getattr(settings, f'runaway_{kind}')
        record['drift'] = getattr(settings, f'drift_{kind}')
        record['moving_speed'] = _MOVING_SPEED[kind]
        record['prove_distance'] = getattr(settings, f'prove_{kind}')
    records['state'] = JointState.IDLE
    for name in _UNKNOWN:
        records[name] = np.nan
    for name in _NEVER:
        records[name] = NO_TIME
    records['lag_high'] = settings.lag_prior_s
    records['ring_step'] = max(HISTORY, 3.0 * settings.lag_prior_s) / RING
    arm = np.zeros(1, dtype=ARM)
    arm['now'] = NO_TIME
    arm['tool_t'] = NO_TIME
    numbers = np.array([tuple(asdict(settings).values())], dtype=SETTINGS)
    return Memory(
        records,
        arm,
        numbers,
        np.zeros((n, RING)),
        np.zeros((n, RING)),
        np.zeros((n, len(LAGS))),
        np.zeros((n, len(LAGS) + 1)),
        LAGS.copy(),
        np.full((n, 3), np.nan),
        np.zeros((n, PAST)),
        np.zeros((n, PAST)),
        np.zeros((n, 4, CELLS)),
    )
