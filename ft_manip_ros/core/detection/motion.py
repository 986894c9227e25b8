"""Compiled: motion without or against the command, late following, and proof of health."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.compiled import kernel
from ft_manip_ros.core.detection.states import Cause
from ft_manip_ros.core.detection.tracking import command_at

Array = NDArray[np.float64]

QUIET: Final = -1

_UNCOMMANDED: Final = int(Cause.MOVES_UNCOMMANDED)
_AGAINST: Final = int(Cause.MOVES_AGAINST_COMMAND)
_SETTLING: Final = 1.5  # s after the command came to rest in which a joint may still swing
_CONFIRM: Final = 0.1  # s
_CONFIRM_SAMPLES: Final = 3
_PROVED_SHARE: Final = 0.3  # of the commanded motion may be missing
_REST_BEFORE_PROOF: Final = 0.2  # s


@kernel
def judge_motion(r: Any, s: Any, ring_t: Array, ring_c: Array, t: float, q: float) -> int:
    """Return QUIET or the `Cause` of a confirmed runaway at this accepted sample."""
    if r.ring_n == 0 or np.isnan(r.command):
        r.runaway_n = 0
        r.drift_t = t
        r.drift_q = q
        return QUIET
    offset = r.offset if r.lag_known else 0.0
    cause = QUIET
    if t - r.command_rest_since > _SETTLING + r.lag_high:
        if t - r.drift_t > s.drift_s:
            r.drift_t = t
            r.drift_q = q
        away, before = abs(q - r.command - offset), abs(r.drift_q - r.command - offset)
        r.rest_wander = max(abs(q - r.drift_q) - r.band, r.rest_wander)
        # Catching up is no runaway: the joint has to leave its command.
        if abs(q - r.drift_q) > r.drift and away > before + 0.5 * r.drift:
            cause = _UNCOMMANDED
    else:
        r.drift_t = t
        r.drift_q = q
        cause = _against(r, ring_t, ring_c, t, q - offset)
    if cause == QUIET:
        r.runaway_n = 0
        return QUIET
    if r.runaway_n == 0:
        r.runaway_since = t
    r.runaway_n += 1
    if r.runaway_n >= _CONFIRM_SAMPLES and (
        cause == _UNCOMMANDED or t - r.runaway_since >= _CONFIRM
    ):
        return cause
    return QUIET


@kernel
def _against(r: Any, ring_t: Array, ring_c: Array, t: float, q: float) -> int:
    """Tell whether the joint is far outside all commands of its lag span, and leaving them."""
    lo = hi = r.command
    for share in (0.5, 1.0):
        c = command_at(r, ring_t, ring_c, t - share * r.lag_high)
        if not np.isnan(c):
            lo, hi = min(lo, c), max(hi, c)
    reach = r.runaway_distance + r.envelope
    step = r.q_1 - r.q_2
    least = 0.2 * r.runaway_distance * (r.t_1 - r.t_2)  # slower than this is creep
    if q > hi + reach and step > least:
        return _AGAINST
    if q < lo - reach and step < -least:
        return _AGAINST
    return QUIET


@kernel
def follow_proof(r: Any, ring_t: Array, ring_c: Array, t: float, q: float) -> None:
    """End PROVING once the joint has followed a commanded motion from rest."""
    c = command_at(r, ring_t, ring_c, t - r.lag)
    if np.isnan(r.prove_q) or r.still_time > _REST_BEFORE_PROOF:
        r.prove_q = q
        r.prove_c = c
        return
    moved = q - r.prove_q
    if abs(moved) < r.prove_distance:
        return
    if np.isnan(c) or np.isnan(r.prove_c):
        # No command is known to anybody here: motion is all the proof there can be.
        r.proving = not np.isnan(r.command)
        r.untrusted = r.proving
        r.prove_c = c
        return
    wanted = c - r.prove_c
    if abs(moved - wanted) <= _PROVED_SHARE * abs(wanted) + r.threshold:
        r.proving = False
        r.untrusted = False
