"""Settings of the fault monitor; the defaults fit every arm and are never tuned per file."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from ft_manip_ros.core.errors import InputError


@dataclass(frozen=True)
class MonitorSettings:
    """Thresholds and windows of the fault monitor.

    Lengths named ``..._revolute`` are in rad, ``..._prismatic`` in m.

    Attributes
    ----------
    sensitivity
        Scales every lock threshold: 2 needs twice the evidence. 1 is the calibrated value.
    confirm_s, confirm_samples
        A joint must have shown no motion for this long (s) and over so many samples.
    lag_prior_s
        Tracking lag (s) granted to every joint at any time, however suddenly it became so late.
    slack_revolute, slack_prismatic
        Commanded motion that a healthy joint may swallow (backlash, friction, dynamic tracking
        error) until its own tracking has been learned; also the most that is ever learned.
    slack_unproved_factor
        Multiplies the slack of a joint that has never been seen to follow a command.
    slack_least_revolute, slack_least_prismatic
        The least slack, however well a joint tracks.
    still_revolute, still_prismatic
        Motion that still counts as none, however quiet the encoder is (brake flex).
    still_fraction
        Share of the commanded motion that still counts as none.
    noise_factor
        Standard deviations of learned noise inside which a joint stands still.
    effort_factor
        Effort beyond this multiple of all effort seen in healthy motion counts as high.
    stale_s, stale_periods
        No sample for this long (s) and so many sample periods makes a joint STALE.
    dead_s
        Bit-for-bit repetition (s) that makes a channel that never repeats a dead one.
    time_jump_s
        Stamps going back by more than this (s), consistently, start a new time line.
    runaway_revolute, runaway_prismatic
        Distance from the command beyond which motion away from it is a RUNAWAY.
    drift_revolute, drift_prismatic
        Motion within ``drift_s`` of a joint commanded to rest that is a RUNAWAY.
    drift_s
        Window (s) of the former: slower creep is not a fault.
    default_velocity_revolute, default_velocity_prismatic
        Largest speed (rad/s, m/s) believed of a joint without a known limit.
    prove_revolute, prove_prismatic
        Motion that a cleared joint must follow before it counts as healthy.
    not_executing_joints
        When at least so many joints are commanded and none of them moves, the arm is not
        executing its commands (stop, refused goal) and no joint is LOCKED; 0 switches that off.
    start_timeout_s
        How long (s) an arm may take to take up a trajectory: a joint that alone is commanded, and
        has not moved since, is LOCKED only after this. Not for streamed references.
    """

    sensitivity: float = 1.0
    confirm_s: float = 0.03
    confirm_samples: int = 4
    lag_prior_s: float = 0.3
    slack_revolute: float = 0.008
    slack_prismatic: float = 0.003
    slack_unproved_factor: float = 1.5
    slack_least_revolute: float = 0.0015
    slack_least_prismatic: float = 0.0005
    still_revolute: float = 1e-4
    still_prismatic: float = 3e-5
    still_fraction: float = 0.05
    noise_factor: float = 5.0
    effort_factor: float = 1.3
    stale_s: float = 0.2
    stale_periods: float = 6.0
    dead_s: float = 0.05
    time_jump_s: float = 1.0
    runaway_revolute: float = 0.25
    runaway_prismatic: float = 0.1
    drift_revolute: float = 0.05
    drift_prismatic: float = 0.02
    drift_s: float = 2.0
    default_velocity_revolute: float = 15.0
    default_velocity_prismatic: float = 3.0
    prove_revolute: float = 0.02
    prove_prismatic: float = 0.008
    not_executing_joints: int = 2
    start_timeout_s: float = 1.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            least = 0 if item.name == 'not_executing_joints' else None
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise InputError(item.name, f'is {value!r}; a number is needed')
            if not math.isfinite(value) or (value < least if least == 0 else value <= 0):
                raise InputError(item.name, f'is {value}; it must be finite and positive')
        if self.still_fraction > 0.5:
            raise InputError('still_fraction', f'is {self.still_fraction}; at most 0.5 is motion')
