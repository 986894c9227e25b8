"""The tool's motion as a witness of whether a joint stands still, or only its encoder.

A joint that is commanded and whose encoder stands is locked, or its encoder is stuck. Where the
tool is seen, its displacement since then tells: by how far the suspect joint would have to have
moved, the others being where their encoders say. Several suspects are solved for together; what
does not tell them apart is said to be unclear, and a tool that says nothing leaves everything to
the joint states.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.detection.layout import NO_TIME, Memory
from ft_manip_ros.core.detection.states import LATCHED, Cause, JointState
from ft_manip_ros.core.detection.stillness import lock_level
from ft_manip_ros.core.detection.tool_model import DELAYS, ToolModel
from ft_manip_ros.core.detection.tool_verdicts import VOTES, Pose, ToolVerdicts
from ft_manip_ros.core.errors import InputError

Array = NDArray[np.float64]

_SAMPLES = 2048  # postures kept, to know where the arm was when the tool was seen
_PENDING = 64  # poses that may wait for the joint states of their time
_CLOCKS = 1.0  # s that stamps of poses and joint states may be apart
_RESPITE = 0.5  # s for which no joint must be suspected before a pose is learned
_SUSPECT = 0.5  # evidence for a lock at which the tool is asked
_LONGEST_WAIT = 0.3  # s that a lock is held back for the tool's word
_LONGEST_PERIOD = 0.5  # s between poses; what is longer is a gap
_DOUBTED = (JointState.SENSOR, JointState.STALE)
_UNSEEN = (Cause.NO_MOTION, Cause.NO_MOTION_HIGH_EFFORT, Cause.TOOL_UNCLEAR)


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
        self._verdicts = ToolVerdicts(self.model, memory, places)
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
        lock_level(self._memory.joints[self._places[0]])
        self._verdicts.warm_up()

    def clear(self) -> None:
        """Begin a new time line; what was learned of the tool stays."""
        self._head = 0
        self._count = 0
        self._newest = -1.0
        self._suspected = -np.inf
        self._waiting: deque[tuple[float, Array]] = deque(maxlen=_PENDING)
        self._fresh: deque[tuple[float, Array, Array]] = deque()
        self._past: deque[Pose] = deque(maxlen=400)
        self._verdicts.clear()
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
        wait = self._age + self.model.delay + (VOTES + 1) * self._period
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
        self._past.append(Pose(t - self.model.delay, posture, seen))
        if suspects:
            self._verdicts.judge(self._past, suspects, clean and self.model.believed)

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
