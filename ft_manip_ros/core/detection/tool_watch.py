"""The tool's motion as a witness of whether a joint stands still, or only its encoder.

A joint that is commanded and whose encoder stands is locked, or its encoder is stuck. Where the
tool is seen, its displacement since then tells: by how far the suspect joint would have to have
moved, the others being where their encoders say. Several suspects are solved for together; what
does not tell them apart is said to be unclear, and a tool that says nothing leaves everything to
the joint states.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.detection.layout import NO_TIME, Memory
from ft_manip_ros.core.detection.states import LATCHED, Cause, JointState, ToolWord
from ft_manip_ros.core.detection.stillness import lock_level
from ft_manip_ros.core.detection.tool_model import DELAYS, ToolModel
from ft_manip_ros.core.detection.tracking import command_at
from ft_manip_ros.core.errors import InputError

Array = NDArray[np.float64]

_SAMPLES = 2048  # postures kept, to know where the arm was when the tool was seen
_PENDING = 64  # poses that may wait for the joint states of their time
_CLOCKS = 1.0  # s that stamps of poses and joint states may be apart
_RESPITE = 0.5  # s for which no joint must be suspected before a pose is learned
_BASELINE = 1.0  # s before the suspicion, whose poses say where the tool was
_BASELINE_POSES = 10
_SUSPECT = 0.5  # evidence for a lock at which the tool is asked
_POWER = 6.0  # standard deviations that the tool must move if the joint does
_MOVED = 0.4  # of the least motion that is expected of a joint that moves
_STOOD = 0.2  # of it, beyond the noise, of one that stands
_SIGMAS = 3.0
_ASTRAY = 0.3  # of the motion found, that may point elsewhere
_VOTES = 3  # poses in a row: a tracker may be wrong once, or twice
_EFFORT_KNOWN = 200  # samples of it
_LONGEST_WAIT = 0.3  # s that a lock is held back for the tool's word
_LONGEST_PERIOD = 0.5  # s between poses; what is longer is a gap
_DOUBTED = (JointState.SENSOR, JointState.STALE)
_UNSEEN = (Cause.NO_MOTION, Cause.NO_MOTION_HIGH_EFFORT, Cause.TOOL_UNCLEAR)


class _Pose(NamedTuple):
    time: float  # s, less the delay
    posture: Array  # (n,), by the encoders
    seen: Array  # (3,), m


class ToolWatch:
    """Takes positions of the tool and notes in the monitor's memory what they say of suspects.

    Parameters
    ----------
    chain
        The arm.
    memory
        Of the monitor; `ToolWord` of each joint and what is known of the poses are written.
    places
        Place in the memory of each of the chain's joints, base to tip.
    """

    def __init__(self, chain: SerialChain, memory: Memory, places: NDArray[np.int64]) -> None:
        self.model = ToolModel(chain)
        self._memory = memory
        self._places = places
        self._times = np.zeros(_SAMPLES)
        self._postures = np.zeros((_SAMPLES, chain.n))
        self._votes = np.zeros(chain.n, dtype=np.int64)
        self._period = 0.0
        self._age = 0.0
        self.clear()

    @property
    def text(self) -> str:
        """One sentence for a person."""
        model = self.model
        if self._newest < 0.0:
            return 'no pose of the tool seen'
        if model.believed:
            return (
                f'the tool moves with the arm to within {model.noise:.2g} m, '
                f'{model.delay:.3g} s late'
            )
        if np.isfinite(model.noise) and model.spread > 0.0:
            return f'the tool is not seen to move with the arm (to within {model.noise:.2g} m)'
        return 'the tool has not been seen to move with the arm yet'

    def warm_up(self) -> None:
        """Compile what judging a pose needs."""
        r = self._memory.joints[self._places[0]]
        lock_level(r)
        self._expected(0, r, 0.0, 0.0)
        self.model.reach(np.zeros(len(self._places)), 0, 0.0)

    def clear(self) -> None:
        """Begin a new time line; what was learned of the tool stays."""
        self._head = 0
        self._count = 0
        self._newest = -1.0
        self._suspected = -np.inf
        self._waiting: deque[tuple[float, Array]] = deque(maxlen=_PENDING)
        self._fresh: deque[tuple[float, Array, Array]] = deque()
        self._past: deque[_Pose] = deque(maxlen=400)
        self._votes[:] = 0
        self._memory.arm['tool_t'] = NO_TIME

    def pose(self, t: float, seen: Array) -> None:
        """Take the tool's position (3,), m, at ``t`` (s).

        Raises
        ------
        InputError
            For numbers that are not finite, and stamps of another clock than the joint states'.
        """
        if seen.shape != (3,) or not np.isfinite(seen).all():
            raise InputError('tool_pose.position', f'is {seen.tolist()}; needs finite x, y, z')
        if self._count == 0:
            return
        now = self._times[(self._head - 1) % _SAMPLES]
        if abs(t - now) > _CLOCKS:
            raise InputError(
                'tool_pose.header.stamp',
                f'is {abs(t - now):.3g} s {"ahead of" if t > now else "behind"} the joint states; '
                f'at most {_CLOCKS:g} s can be allowed for',
            )
        if t <= self._newest:
            return
        if self._newest >= 0.0:
            period = min(t - self._newest, _LONGEST_PERIOD)
            self._period += 0.1 * (period - self._period) if self._period else period
        self._newest = t
        self._age += 0.1 * (max(now - t, 0.0) - self._age)
        arm = self._memory.arm[0]
        wait = self._age + self.model.delay + (_VOTES + 1) * self._period
        arm['tool_t'] = now
        arm['tool_wait'] = wait if self.model.believed and wait <= _LONGEST_WAIT else 0.0
        self._waiting.append((t, seen))
        self._work_off(now)

    def sample(self, t: float) -> None:
        """Note the believed posture after the joint states of time ``t`` (s)."""
        if self._count and t <= self._times[(self._head - 1) % _SAMPLES]:
            return
        self._times[self._head] = t
        self._postures[self._head] = self._memory.joints['q'][self._places]
        self._head = (self._head + 1) % _SAMPLES
        self._count = min(self._count + 1, _SAMPLES)
        if self._waiting:
            self._work_off(t)

    def _work_off(self, now: float) -> None:
        while self._waiting and self._waiting[0][0] <= now:
            self._take(now, *self._waiting.popleft())

    def _take(self, now: float, t: float, seen: Array) -> None:
        postures = self._at(t - np.append(DELAYS, self.model.delay))
        suspects, clean = self._suspects()
        if suspects or not clean:
            self._suspected = now
            self._fresh.clear()
        else:
            self._fresh.append((t, postures, seen))
            while self._fresh and now - self._fresh[0][0] > _RESPITE:
                _, learned, point = self._fresh.popleft()
                if np.isfinite(learned).all():
                    self.model.learn(learned, point)
        posture = postures[-1]
        if not np.isfinite(posture).all():
            return
        self._past.append(_Pose(t - self.model.delay, posture, seen))
        if suspects:
            self._judge(suspects, clean and self.model.believed)

    def _at(self, times: Array) -> Array:
        """Postures (N, n) at times (N,) by interpolation; NaN beyond what is kept."""
        order = np.arange(self._head - self._count, self._head) % _SAMPLES
        kept = self._times[order]
        k = np.searchsorted(kept, times, side='right')
        last = np.clip(k - 1, 0, self._count - 1)
        after = np.clip(k, 0, self._count - 1)
        gap = kept[after] - kept[last]
        part = np.where(gap > 0.0, (times - kept[last]) / np.where(gap > 0.0, gap, 1.0), 0.0)
        before, then = self._postures[order[last]], self._postures[order[after]]
        out = before + np.clip(part, 0.0, 1.0)[:, None] * (then - before)
        out[k == 0] = np.nan
        return np.asarray(out)

    def _suspects(self) -> tuple[list[int], bool]:
        """Suspect joints (places in the chain), and whether all other encoders are believed."""
        suspects = []
        clean = True
        for i, j in enumerate(self._places):
            r = self._memory.joints[j]
            state = JointState(int(r['state']))
            if state in LATCHED:
                # Such an angle was not confirmed by the tool: nothing is learned with it.
                clean = clean and int(r['cause']) not in _UNSEEN
            elif r['stuck'] or (not r['exempt'] and lock_level(r) >= _SUSPECT):
                suspects.append(i)
            elif state in _DOUBTED or r['untrusted']:
                clean = False
        return suspects, clean

    def _judge(self, suspects: list[int], believed: bool) -> None:
        """Write down what the latest pose says of each suspect."""
        latest = self._past[-1]
        records = [self._memory.joints[self._places[i]] for i in suspects]
        since = min(float(r['missing_since']) for r in records)
        first = [pose for pose in self._past if since - _BASELINE <= pose.time <= since + 1e-9][
            -_BASELINE_POSES:
        ]
        if not believed or not first:
            for i, r in zip(suspects, records, strict=True):
                self._say(i, r, ToolWord.NOTHING)
            return
        if latest.time <= since:
            return
        model = self.model
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
        latest: _Pose,
    ) -> None:
        model = self.model
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

    def _hopeless(self, i: int, r: np.void, latest: _Pose, sigma: float) -> bool:
        """Whether the tool would not tell even by where the command stands now."""
        ahead = float(r['command']) - float(r['still_q'])
        if not np.isfinite(ahead):
            return True
        motion = np.copysign(max(abs(ahead), 2.0 * float(r['threshold'])), ahead)
        reach = float(np.linalg.norm(self.model.reach(latest.posture, i, float(motion))))
        doubt = 0.0 if r['prismatic'] else abs(motion) * self.model.offset_sigma
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
        needed = _VOTES + (0 if not known else 1 if r['high_effort'] else -1)
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
