"""What the tool's motion says of joints that are suspected to be locked.

The tool's displacement since the suspicion began is compared with what the suspect joint's
commanded motion would have made of it, the other joints being where their encoders say.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.detection.layout import Memory
from ft_manip_ros.core.detection.states import ToolWord
from ft_manip_ros.core.detection.tool_model import ToolModel
from ft_manip_ros.core.detection.tracking import command_at

Array = NDArray[np.float64]

VOTES = 3  # poses in a row that say "moved": a tracker may be wrong once, or twice
_BASELINE = 1.0  # s before the suspicion, whose poses say where the tool was
_BASELINE_POSES = 10
_POWER = 6.0  # standard deviations that the tool must move if the joint does
_MOVED = 0.4  # of the least motion that is expected of a joint that moves
_STOOD = 0.2  # of it, beyond the noise, of one that stands
_SIGMAS = 3.0
_ASTRAY = 0.3  # of the motion found, that may point elsewhere
_EFFORT_KNOWN = 200  # samples of it


class Pose(NamedTuple):
    """A position of the tool and the posture of that moment."""

    time: float  # s, less the delay
    posture: Array  # (n,), by the encoders
    seen: Array  # (3,), m


class ToolVerdicts:
    """Judges suspects by poses of the tool; the word on each is written to the memory.

    Parameters
    ----------
    model
        What is known of the tool.
    memory
        Of the monitor.
    places
        Place in the memory of each of the chain's joints, base to tip.
    """

    def __init__(self, model: ToolModel, memory: Memory, places: NDArray[np.int64]) -> None:
        self._model = model
        self._memory = memory
        self._places = places
        self._votes = np.zeros(len(places), dtype=np.int64)

    def warm_up(self) -> None:
        """Compile what judging a pose needs."""
        self._expected(0, self._memory.joints[self._places[0]], 0.0, 0.0)
        self._model.reach(np.zeros(len(self._places)), 0, 0.0)

    def clear(self) -> None:
        """Count no votes of before."""
        self._votes[:] = 0

    def judge(self, past: Iterable[Pose], suspects: list[int], believed: bool) -> None:
        """Write down what the latest pose says of each suspect.

        Parameters
        ----------
        past
            Poses by time.
        suspects
            Places in the chain.
        believed
            Whether the tool, and the encoders of all other joints, are.
        """
        *earlier, latest = past
        records = [self._memory.joints[self._places[i]] for i in suspects]
        since = min(float(r['missing_since']) for r in records)
        first = [
            pose for pose in (*earlier, latest) if since - _BASELINE <= pose.time <= since + 1e-9
        ][-_BASELINE_POSES:]
        if not believed or not first:
            for i, r in zip(suspects, records, strict=True):
                self._say(i, r, ToolWord.NOTHING)
            return
        if latest.time <= since:
            return
        model = self._model
        points = model.points(np.array([pose.posture for pose in (*first, latest)]))
        where = np.mean([pose.seen for pose in first], axis=0) - points[:-1].mean(axis=0)
        moved = latest.seen - points[-1] - where
        sigma = model.noise * np.sqrt(1.0 + 1.0 / len(first))
        least = [
            self._expected(i, r, since, latest.time)
            for i, r in zip(suspects, records, strict=True)
        ]
        columns = np.array(
            [model.reach(latest.posture, i, a) for i, a in zip(suspects, least, strict=True)]
        )
        if len(suspects) == 1:
            self._judge_one(suspects[0], records[0], least[0], columns[0], moved, sigma, latest)
            return
        self._judge_several(suspects, records, columns, moved, sigma)

    def _expected(self, i: int, r: np.void, since: float, t: float) -> float:
        """Least motion that joint ``i`` made by ``t`` if it followed, over its believable lags."""
        j = self._places[i]
        ring_t, ring_c = self._memory.ring_t[j], self._memory.ring_c[j]
        motions = []
        for lag in (float(r['lag_low']), float(r['lag']), float(r['lag_high'])):
            motion = command_at(r, ring_t, ring_c, t - lag) - command_at(
                r, ring_t, ring_c, since - lag
            )
            if np.isnan(motion):
                return 0.0
            motions.append(motion)
        least = min(motions, key=abs)
        return float(least) if all(least * motion >= 0.0 for motion in motions) else 0.0

    def _judge_one(
        self,
        i: int,
        r: np.void,
        least: float,
        column: Array,
        moved: Array,
        sigma: float,
        latest: Pose,
    ) -> None:
        model = self._model
        length = float(np.linalg.norm(column))
        doubt = 0.0 if r['prismatic'] else abs(least) * model.offset_sigma
        if length < _POWER * sigma or doubt > _ASTRAY * length:
            hopeless = self._hopeless(i, r, latest, sigma)
            self._say(i, r, ToolWord.NOTHING if hopeless else ToolWord.AWAITED)
            return
        motion = model.motion_of(latest.posture, i, 0.0, moved)
        found = model.reach(latest.posture, i, motion)
        astray = float(np.linalg.norm(moved - found))
        share = motion / least
        if astray > (_SIGMAS + 1.0) * sigma + _ASTRAY * float(np.linalg.norm(found)):
            word = ToolWord.UNCLEAR
        elif share >= _MOVED and share * length >= _SIGMAS * sigma:
            word = ToolWord.MOVED
        elif abs(share) * length <= _SIGMAS * sigma + _STOOD * length:
            word = ToolWord.STOOD
        else:
            word = ToolWord.AWAITED
        self._say(i, r, word)

    def _judge_several(
        self,
        suspects: list[int],
        records: list[np.void],
        columns: Array,
        moved: Array,
        sigma: float,
    ) -> None:
        """Solve for the shares of several suspects; those not told apart are unclear."""
        lengths = np.linalg.norm(columns, axis=1)
        strong = lengths >= _POWER * sigma
        if not strong.any():
            for i, r in zip(suspects, records, strict=True):
                self._say(i, r, ToolWord.AWAITED)
            return
        if float(np.linalg.norm(moved)) <= _SIGMAS * sigma + _STOOD * float(lengths[strong].min()):
            words = [ToolWord.STOOD if ok else ToolWord.NOTHING for ok in strong]
        else:
            shares, spreads, astray = _shares(columns, moved, sigma)
            straight = astray <= (_SIGMAS + 1.0) * sigma + _ASTRAY * float(np.linalg.norm(moved))
            words = []
            for share, spread in zip(shares, spreads, strict=True):
                if not straight or spread > 1.0 / _POWER:
                    words.append(ToolWord.UNCLEAR)
                elif share >= _MOVED and share >= _SIGMAS * spread:
                    words.append(ToolWord.MOVED)
                elif abs(share) <= _STOOD + _SIGMAS * spread:
                    words.append(ToolWord.STOOD)
                else:
                    words.append(ToolWord.AWAITED)
        for i, r, word in zip(suspects, records, words, strict=True):
            self._say(i, r, word)

    def _hopeless(self, i: int, r: np.void, latest: Pose, sigma: float) -> bool:
        """Whether the tool would not tell even by where the command stands now."""
        ahead = float(r['command']) - float(r['still_q'])
        if not np.isfinite(ahead):
            return True
        motion = np.copysign(max(abs(ahead), 2.0 * float(r['threshold'])), ahead)
        reach = float(np.linalg.norm(self._model.reach(latest.posture, i, float(motion))))
        doubt = 0.0 if r['prismatic'] else abs(motion) * self._model.offset_sigma
        return bool(reach < _POWER * sigma or doubt > _ASTRAY * reach)

    def _say(self, i: int, r: np.void, word: ToolWord) -> None:
        """Note a word; that a joint moved takes several poses in a row, and then holds."""
        if r['tool_word'] == ToolWord.MOVED:
            return
        if r['tool_word'] == ToolWord.UNASKED:
            self._votes[i] = 0
        if word != ToolWord.MOVED:
            self._votes[i] = 0
            r['tool_word'] = word
            return
        self._votes[i] += 1
        # A locked joint strains, one that moves unseen does not.
        known = r['effort_n'] >= _EFFORT_KNOWN
        needed = VOTES + (0 if not known else 1 if r['high_effort'] else -1)
        r['tool_word'] = word if self._votes[i] >= needed else ToolWord.AWAITED


def _shares(columns: Array, moved: Array, sigma: float) -> tuple[Array, Array, float]:
    """Least-squares shares (m,) of columns (m, 3), their deviations, and what is left over."""
    gram = columns @ columns.T
    if len(columns) > 3 or np.linalg.cond(gram) > 1e8:
        return np.zeros(len(columns)), np.full(len(columns), np.inf), 0.0
    inverse = np.linalg.inv(gram)
    shares = inverse @ (columns @ moved)
    spreads = sigma * np.sqrt(np.diag(inverse))
    return shares, spreads, float(np.linalg.norm(moved - columns.T @ shares))
