"""A simulated arm: servos that follow joint paths, encoders that report, joints that fail."""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.joint_path import JointPath

# The servo equations are integrated at this fixed step (s), whoever asks when.
STEP = 1e-3
# A sluggish joint falls behind by so much a second, and by no more than this in the end (s).
_FALLING = 0.1
MOST_LATE = 1.0
# How far a path may leave the limits, as part of the range: a stop that begins beside a limit
# ends beyond it, and the mechanical stop takes the rest.
_LIMIT_SLACK = 0.02


@dataclass(frozen=True)
class SimSettings:
    """What the simulated hardware is like.

    Attributes
    ----------
    servo_frequency
        Natural frequency of each critically damped servo, rad/s: it follows a moving command
        ``2 / servo_frequency`` seconds late.
    acceleration_reserve
        What the drives can do beyond the accelerations the chain lists, as a factor >= 1.
    noise
        One standard deviation of a position reading, rad or m.
    velocity_noise
        One standard deviation of a velocity reading, rad/s or m/s.
    resolution
        Smallest step of a position reading, rad or m; 0: none.
    seed
        Of the noise.
    """

    servo_frequency: float = 60.0
    acceleration_reserve: float = 2.0
    noise: float = 2e-5
    velocity_noise: float = 1e-3
    resolution: float = 1e-5
    seed: int = 0

    def __post_init__(self) -> None:
        for key in ('noise', 'velocity_noise', 'resolution'):
            value = getattr(self, key)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f'simulated arm: {key}', f'is {value}; must be finite and >= 0')
        # Beyond this the fixed step would no longer resolve the servo.
        if not 0.0 < self.servo_frequency <= 0.5 / STEP:
            raise InputError(
                'simulated arm: servo_frequency',
                f'is {self.servo_frequency}; must be above 0 and at most {0.5 / STEP:g} rad/s',
            )
        if not (math.isfinite(self.acceleration_reserve) and self.acceleration_reserve >= 1.0):
            raise InputError(
                'simulated arm: acceleration_reserve',
                f'is {self.acceleration_reserve}; must be at least 1',
            )


class SimulatedArm:
    """An arm of independent servos, the same for the same seed and the same calls.

    Times are seconds on any one clock; they may not run backwards.

    Parameters
    ----------
    chain
        The arm: joint names, limits, speeds.
    settings
        What its hardware is like.
    start : shape (n,), optional
        Where it stands; by default 0, or the middle of the limits where they exclude 0.
    time
        Now.
    """

    def __init__(
        self,
        chain: SerialChain,
        settings: SimSettings | None = None,
        *,
        start: Array | None = None,
        time: float = 0.0,
    ) -> None:
        self.chain = chain
        self.settings = settings or SimSettings()
        self._rng = np.random.default_rng(self.settings.seed)
        middle = 0.5 * (chain.lower + chain.upper)
        home = np.where((chain.lower <= 0.0) & (chain.upper >= 0.0), 0.0, middle)
        self.position = home if start is None else chain.check_vector(start, 'start').copy()
        wraps = chain.arrays.wraps
        self._lower = np.where(wraps, -np.inf, np.minimum(chain.lower, self.position))
        self._upper = np.where(wraps, np.inf, np.maximum(chain.upper, self.position))
        self.velocity = np.zeros(chain.n)
        self.locked = np.zeros(chain.n, dtype=bool)
        # How late each joint hears its command, s: in the end, and now.
        self._late = np.zeros(chain.n)
        self._behind = np.zeros(chain.n)
        self._heard = np.tile(self.position, (round(MOST_LATE / STEP) + 1, 1))
        self._origin = time
        self._steps = 0
        self._path = JointPath(chain.joint_names, np.zeros(1), self.position[None, :])
        self._path_start = time
        # Joints whose encoder repeats what it last read, and that reading.
        self._stuck = np.zeros(chain.n, dtype=bool)
        self._held = self.position.copy()
        # (time, number of the request, joint, whether it locks, how late it is, whether its
        # encoder sticks)
        self._events: list[tuple[float, int, int, bool, float, bool]] = []
        self._requests = 0

    @property
    def time(self) -> float:
        """Time up to which the motion has been worked out."""
        return self._origin + self._steps * STEP

    @property
    def locked_joints(self) -> Mapping[str, float]:
        """Where each locked joint truly stands, rad or m, by name."""
        return {
            name: float(self.position[i])
            for i, name in enumerate(self.chain.joint_names)
            if self.locked[i]
        }

    def follow(self, path: JointPath, start: float | None = None) -> None:
        """Follow a path from now on, instead of the present one.

        Parameters
        ----------
        path
            All joints of the arm, in any order.
        start
            Time of the path's zero; None: now. A start in the past skips what is past.

        Raises
        ------
        InputError
            For unknown, missing or repeated joints and for positions clearly beyond the physical
            limits; the arm then goes on with what it was doing.
        """
        path = path.ordered(self.chain.joint_names)
        slack = _LIMIT_SLACK * (self._upper - self._lower)
        outside = (path.positions < self._lower - slack) | (path.positions > self._upper + slack)
        if outside.any():
            point, joint = (int(k) for k in np.argwhere(outside)[0])
            raise InputError(
                f'trajectory: points[{point}].positions of {self.chain.joint_names[joint]}',
                f'is {path.positions[point, joint]:.6g}, outside '
                f'[{self._lower[joint]:.6g}, {self._upper[joint]:.6g}]',
            )
        self._path = path.preceded_by(self.position, self.velocity)
        self._path_start = self.time if start is None else start

    def lock(self, joint: str, time: float) -> None:
        """Lock a joint where it will stand at ``time``: it stops and ignores commands."""
        self._schedule(joint, time, True, 0.0)

    def release(self, joint: str, time: float) -> None:
        """Let a joint, and its encoder, work again from ``time`` on."""
        self._schedule(joint, time, False, 0.0)

    def slow(self, joint: str, time: float, lag: float) -> None:
        """Let a joint fall behind its command from ``time`` on, by ``lag`` (s) in the end.

        Raises
        ------
        InputError
            For a lag that is not above 0 and at most `MOST_LATE`, or an unknown joint.
        """
        if not 0.0 < lag <= MOST_LATE:
            raise InputError('lag', f'is {lag}; must be above 0 and at most {MOST_LATE:g} s')
        self._schedule(joint, time, False, lag)

    def stick(self, joint: str, time: float) -> None:
        """Let a joint's encoder repeat its reading from ``time`` on; the joint itself works."""
        self._schedule(joint, time, False, 0.0, stuck=True)

    def _schedule(
        self, joint: str, time: float, lock: bool, lag: float, stuck: bool = False
    ) -> None:
        index = self.chain.index(joint)
        if not math.isfinite(time):
            raise InputError(f'fault of {joint}: time', f'is {time}; must be finite')
        self._requests += 1
        heapq.heappush(self._events, (time, self._requests, index, lock, lag, stuck))
        self._apply_events()

    def advance(self, time: float) -> None:
        """Move on to ``time`` (s), in fixed steps; a time in the past changes nothing."""
        target = math.floor((time - self._origin) / STEP + 1e-6)
        while self._steps < target:
            self._step()
            self._steps += 1
            self._apply_events()

    def measure(self) -> tuple[Array, Array]:
        """Read all encoders once: positions and velocities, each shape (n,), with noise."""
        n, settings = self.chain.n, self.settings
        position = self.position + settings.noise * self._rng.standard_normal(n)
        position = np.where(self._stuck, self._held, self._rounded(position))
        velocity = self.velocity + settings.velocity_noise * self._rng.standard_normal(n)
        # The driver has its velocity from the same encoder.
        return position, np.where(self._stuck, 0.0, velocity)

    def _rounded(self, position: Array) -> Array:
        step = self.settings.resolution
        return np.round(position / step) * step if step > 0.0 else position

    def _step(self) -> None:
        command, _ = self._path.sample(self.time + STEP - self._path_start)
        command = self._hear(command)
        w = self.settings.servo_frequency
        reserve = self.settings.acceleration_reserve * self.chain.acceleration
        # Critically damped and without feed-forward, so no speed or acceleration of the motion
        # exceeds what the commanded path itself asks for. Implicit in the velocity: stable.
        wanted = (self.velocity + STEP * w * w * (command - self.position)) / (
            1.0 + 2.0 * w * STEP + (w * STEP) ** 2
        )
        change = np.clip(wanted - self.velocity, -STEP * reserve, STEP * reserve)
        speed = np.clip(self.velocity + change, -self.chain.velocity, self.chain.velocity)
        speed[self.locked] = 0.0
        position = np.clip(self.position + STEP * speed, self._lower, self._upper)
        # A mechanical stop takes the speed away.
        speed[(position == self._lower) | (position == self._upper)] = 0.0
        self.position, self.velocity = position, speed

    def _hear(self, command: Array) -> Array:
        """Command as each joint hears it: sluggish ones hear what was said a while ago."""
        newest = self._steps % len(self._heard)
        self._heard[newest] = command
        if not (self._late.any() or self._behind.any()):
            return command
        change = np.clip(self._late - self._behind, -_FALLING * STEP, _FALLING * STEP)
        self._behind += change
        back = np.rint(self._behind / STEP).astype(int)
        return self._heard[(newest - back) % len(self._heard), np.arange(len(command))]

    def _apply_events(self) -> None:
        while self._events and self._events[0][0] <= self.time + 1e-9:
            _, _, joint, lock, lag, stuck = heapq.heappop(self._events)
            if stuck and not self._stuck[joint]:
                self._held[joint] = self._rounded(self.position)[joint]
            self._stuck[joint] = stuck
            self.locked[joint] = lock
            self._late[joint] = lag
            if lock:
                self.velocity[joint] = 0.0
