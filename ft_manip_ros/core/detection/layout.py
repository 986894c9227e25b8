"""Memory of the fault monitor, laid out for the compiled kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.detection.settings import MonitorSettings

RING = 512  # command samples kept for each joint
HISTORY = 1.0  # s, that they span at least
CELLS = 24  # lags that a stillness window tells apart
PAST = 128  # position samples kept for each joint
NO_TIME = -1.0e18  # s, before anything
# Tracking lags (s) that are compared with one another; the prior is beyond the usual ones.
LAGS = np.array([0.0, 0.008, 0.016, 0.025, 0.035, 0.05, 0.07, 0.095, 0.125, 0.16, 0.2, 0.25, 0.32])

_FLAGS = (
    'prismatic',
    'exempt',
    'wraps',
    'has_sample',
    'has_moved',
    'manual',
    'proving',
    'lag_known',
    'command_moves',
    'high_effort',
    'dead',
    'stop_counted',
    'untrusted',
    'taken_up',
    'through',
    'weighing',
    'keeps_pace',
    'catch_through',
    'stuck',
)
_COUNTS = (
    'state',
    'cause',
    'turns',
    # samples in a row or in all
    'period_n',
    'bad_run',
    'bad_cause',
    'good_run',
    'late_run',
    'repeat_run',
    'changes',
    'reversals',
    'comparisons',
    'rebase_n',
    'noise_n',
    'rough_n',
    'follow_n',
    'effort_n',
    'still_n',
    'contradictions',
    'runaway_n',
    'slip_n',
    'jerks',
    'suspects',
    'starts',
    'ring_head',
    'ring_n',
    'past_n',
    'moving_n',
    'stops',
    'changes_ever',
    'tool_word',
)
_NUMBERS = (
    # known of the joint beforehand (rad or m, /s)
    'lower',
    'upper',
    'velocity_limit',
    'slack',
    'slack_least',
    'still_least',
    'runaway_distance',
    'drift',
    'prove_distance',
    'moving_speed',
    # the latest believed samples; _1 and _2 are the last two
    't',
    'q',
    'v',
    'effort',
    'period',
    'q_1',
    'q_2',
    't_1',
    't_2',
    'raw_1',
    'raw_step',
    'change_sum',
    # unbelievable samples
    'bad_since',
    'good_since',
    'rebase_q',
    'rebase_t',
    'rebase_since',
    'repeat_since',
    'longest_repeat',
    # the command
    'command',
    'command_speed',
    'ring_step',
    'command_mean',
    'pace_t',
    'pace_q',
    'command_rest_since',
    'command_rest_value',
    'departed',
    'depart_q',
    # noise
    'noise_var',
    'rough_var',
    'follow_var',
    'follow_1',
    'follow_t',
    'quantum',
    # the stillness window
    'still_since',
    'still_q',
    'still_sum',
    'still_time',
    'late_mean',
    'look_lag',
    'look_lo',
    'look_hi',
    'rest_lo',
    'rest_hi',
    'weigh_since',
    'way',
    'anchor_t',
    'anchor_q',
    'before_t',
    'before_q',
    'came_t',
    'came_q',
    'lag_used',
    'missing',
    'missing_since',
    'threshold',
    'band',
    'suspect_since',
    'reached_since',
    # what a healthy joint swallowed
    'started',
    'start_late',
    'catch_q',
    'catch_missing',
    'catch_level',
    'catch_t',
    'swallow_start',
    'swallow_way',
    # tracking
    'lag',
    'lag_low',
    'lag_high',
    'lag_first',
    'offset',
    'envelope',
    'rest_wander',
    'moved_s',
    'last_jerk',
    'effort_envelope',
    # speed and braking of a joint without command
    'stop_speed',
    'braking',
    # motion without or against the command, proof of health
    'drift_q',
    'drift_t',
    'runaway_since',
    'prove_q',
    'prove_c',
    # verdict
    'first_evidence',
    'confirmed',
    'frozen_q',
    'frozen_sigma',
    'slip_since',
    'tool_asked',
)
JOINT = np.dtype(
    [(name, np.bool_) for name in _FLAGS]
    + [(name, np.int64) for name in _COUNTS]
    + [(name, np.float64) for name in _NUMBERS],
    align=True,
)
ARM = np.dtype(
    [
        ('messages', np.int64),
        ('resets', np.int64),  # new time lines so far
        ('back_n', np.int64),  # messages of a time line that may be beginning
        ('repeat_run', np.int64),  # messages in a row that repeat the one before bit for bit
        ('repeats', np.int64),  # such messages in healthy runs, at rest
        ('rests', np.int64),  # messages in which every joint stood still
        ('now', np.float64),  # s, latest stamp
        ('first', np.float64),  # s, first stamp of this time line
        ('back_since', np.float64),
        ('back_last', np.float64),
        ('repeat_since', np.float64),
        ('longest_repeat', np.float64),
        ('load', np.float64),  # rad or m, the largest sag seen at rest, of any joint
        ('tool_t', np.float64),  # s, when the latest pose of the tool came
        ('tool_wait', np.float64),  # s, that its word on a suspect may take
    ],
    align=True,
)
SETTINGS = np.dtype([(name, np.float64) for name in MonitorSettings.__dataclass_fields__])


class Memory(NamedTuple):
    """Everything the monitor remembers, as arrays; one record for each of the n joints."""

    joints: NDArray[np.void]  # (n,) of JOINT
    arm: NDArray[np.void]  # (1,) of ARM
    settings: NDArray[np.void]  # (1,) of SETTINGS
    ring_t: NDArray[np.float64]  # (n, RING), s, when the command was recorded
    ring_c: NDArray[np.float64]  # (n, RING), rad or m
    lag_mean: NDArray[np.float64]  # (n, LAGS), mean of q - c(t - lag) in motion
    lag_var: NDArray[np.float64]  # (n, LAGS + 1), its variance; last: that of c itself
    lags: NDArray[np.float64]  # (LAGS,), s
    raw: NDArray[np.float64]  # (n, 3), position, velocity and effort as last reported
    past_t: NDArray[np.float64]  # (n, PAST), s, latest samples of joints without command
    past_q: NDArray[np.float64]  # (n, PAST), rad or m
    cells: NDArray[np.float64]  # (n, 4, CELLS), of `lateness`
