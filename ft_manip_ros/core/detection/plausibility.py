"""Compiled: can this sample be believed? Bad samples never touch any estimate."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.detection.states import Cause
from ft_manip_ros.core.detection.tracking import noise_of

BELIEVED: Final = -1
REPEATED_STAMP: Final = -2
NEW_POSITION: Final = -3  # the jump is consistent: believed from here on

_NOT_FINITE: Final = int(Cause.NOT_FINITE)
_OUT_OF_RANGE: Final = int(Cause.OUT_OF_RANGE)
_JUMP: Final = int(Cause.JUMP)
_ABSURD: Final = 1e4  # rad or m: no joint ever stands there
RANGE_MARGIN: Final = 0.05  # share of the range by which calibration may be off
_JUMP_MARGIN_REVOLUTE: Final = 0.02  # rad
_JUMP_MARGIN_PRISMATIC: Final = 0.01  # m
_REACH_REVOLUTE: Final = 6.5  # rad, a turn: a driver may find another zero, but no other joint
_REACH_PRISMATIC: Final = 1.0  # m
_FEW_SAMPLES: Final = 50
_CONSISTENT_SAMPLES: Final = 5
_CONSISTENT_TIME: Final = 0.1  # s
_GOOD_SAMPLES: Final = 5
_GOOD_TIME: Final = 0.05  # s
_RESTING: Final = 10  # samples in one place: slow motion leaves it sooner
_SELDOM: Final = 0.02  # share of repeats: drives that hunt and then settle repeat more often
_ENOUGH_COMPARISONS: Final = 300
_NOISE_REVERSALS: Final = 0.4  # share of changes; white noise has 2/3
_FINE: Final = 2.0  # steps that noise spans on an encoder too fine to repeat itself
_LOG_IMPOSSIBLE: Final = -40.0  # log of a chance that never comes true


@kernel
def unwrap(r: Any, raw: float) -> float:
    """Position without the full-turn steps of an encoder that wraps."""
    if not r.wraps or not np.isfinite(raw):
        return raw
    q = raw + 2.0 * np.pi * r.turns
    if r.has_sample and abs(q - r.q) > np.pi and abs(q - r.q) < 3.0 * np.pi:
        shift = 1 if q < r.q else -1
        # A real full-turn step lands close to where the joint was.
        if abs(q + 2.0 * np.pi * shift - r.q) < 0.5 * np.pi:
            r.turns += shift
            q += 2.0 * np.pi * shift
    return q


@kernel
def allowed_step(r: Any, dt: float) -> float:
    """Largest believable motion within ``dt`` (s)."""
    margin = _JUMP_MARGIN_PRISMATIC if r.prismatic else _JUMP_MARGIN_REVOLUTE
    quantum = r.quantum if r.quantum < r.slack else 0.0
    return 1.5 * r.velocity_limit * dt + margin + 10.0 * noise_of(r) + 3.0 * quantum


@kernel
def judge_sample(r: Any, t: float, q: float) -> int:
    """Return BELIEVED, REPEATED_STAMP, NEW_POSITION, or the `Cause` that speaks against it."""
    if t <= r.t:
        return REPEATED_STAMP
    if not np.isfinite(q):
        return _NOT_FINITE
    margin = RANGE_MARGIN * (r.upper - r.lower)
    if abs(q) > _ABSURD or q < r.lower - margin or q > r.upper + margin:
        return _OUT_OF_RANGE
    if not r.has_sample or abs(q - r.q) <= allowed_step(r, t - r.t):
        return BELIEVED
    near = r.rebase_n > 0 and abs(q - r.rebase_q) <= allowed_step(r, t - r.rebase_t)
    if not near:
        r.rebase_n = 0
        r.rebase_since = t
    r.rebase_n += 1
    r.rebase_q = q
    r.rebase_t = t
    reach = _REACH_PRISMATIC if r.prismatic else _REACH_REVOLUTE
    # What came first may have been the nonsense.
    believable = abs(q - r.q) <= reach or r.period_n < _FEW_SAMPLES
    lasting = r.rebase_n >= _CONSISTENT_SAMPLES and t - r.rebase_since >= _CONSISTENT_TIME
    if believable and lasting:
        r.rebase_n = 0
        return NEW_POSITION
    return _JUMP


@kernel
def note_bad(r: Any, t: float, cause: int) -> None:
    """Count an unbelievable sample."""
    if r.bad_run == 0 and r.good_run >= 0:
        r.bad_since = t
    r.bad_run += 1
    r.good_run = 0
    r.bad_cause = cause


@kernel
def note_good(r: Any, t: float) -> None:
    """Count a believable sample; enough of them end a sensor fault."""
    if r.bad_run == 0:
        return
    if r.good_run == 0:
        r.good_since = t
    r.good_run += 1
    if r.good_run >= _GOOD_SAMPLES and t - r.good_since >= _GOOD_TIME:
        r.bad_run = 0
        r.good_run = 0


@kernel
def repeats_unlike_itself(r: Any, t: float, raw: float, dead_s: float) -> bool:
    """Tell whether the channel repeats bit for bit although it always flickers at rest.

    Only flicker to and fro is believed to be noise: filters and creep change without it. Whether a
    run is long is judged by its chance on this channel, so that rounded logs and coarse encoders,
    which repeat all the time, are never suspected.
    """
    if raw != r.raw_1:
        if r.repeat_run > 0:
            r.longest_repeat = max(r.longest_repeat, t - r.repeat_since)
        if r.still_n > _RESTING:
            r.comparisons += r.repeat_run + 1
            r.changes += 1
            r.change_sum += abs(raw - r.raw_1)
            if (raw - r.raw_1) * r.raw_step < 0.0:
                r.reversals += 1
        if not np.isnan(r.raw_1):
            r.changes_ever += 1
        r.raw_step = raw - r.raw_1
        r.raw_1 = raw
        r.repeat_run = 0
        r.repeat_since = t
        return False
    r.repeat_run += 1
    if r.comparisons < _ENOUGH_COMPARISONS or r.reversals < _NOISE_REVERSALS * r.changes:
        return False
    if r.change_sum < _FINE * r.quantum * r.changes:
        return False
    chance = (r.comparisons - r.changes + 1.0) / (r.comparisons + 1.0)
    unlikely = chance < _SELDOM and r.repeat_run * np.log(chance) < _LOG_IMPOSSIBLE
    return unlikely and t - r.repeat_since >= max(dead_s, 5.0 * r.longest_repeat)
