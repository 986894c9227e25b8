"""Simulated healthy telemetry with the oddities of real arms, faster than real time.

Each joint follows its command through a pure delay, a first-order servo, backlash and gravity sag;
its encoder adds offset, noise and quantisation; velocities are low-pass filtered as drivers do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ft_manip_ros.core.detection.recording import Recording

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ArmModel:
    """What a simulated arm is like; arrays have shape (n,).

    Attributes
    ----------
    rate
        Joint states per second.
    delay, servo
        Pure delay and time constant of each joint's tracking, s.
    offset
        Steady difference between reading and command, rad.
    sag
        Additional reading at full gravity torque, rad, times the sine of the position.
    payload
        Sag that a payload adds while it is carried, rad.
    backlash
        Width of the play between drive and encoder, rad.
    noise
        One standard deviation of each reading, rad.
    quantum
        Encoder step, rad; 0 for none.
    jitter
        Share of the period by which stamps vary.
    loss
        Share of messages lost.
    """

    rate: float
    delay: Array
    servo: Array
    offset: Array
    sag: Array
    payload: Array
    backlash: Array
    noise: Array
    quantum: Array
    jitter: float = 0.0
    loss: float = 0.0


def random_arm(rng: np.random.Generator, n: int = 6, rate: float | None = None) -> ArmModel:
    """An arm as one may meet it, from a precise industrial one to hobby servos."""
    grade = rng.uniform(0.0, 1.0)  # 0: precise, 1: hobby
    if rate is None:
        rate = float(rng.choice([10.0, 25.0, 50.0, 100.0, 125.0, 250.0, 500.0, 1000.0]))
    return ArmModel(
        rate=rate,
        delay=rng.uniform(0.0, 0.004 + 0.1 * grade, n),
        servo=rng.uniform(0.004, 0.01 + 0.09 * grade, n),
        offset=np.deg2rad(rng.uniform(-1.0, 1.0, n) * 4.0 * grade**2),
        sag=np.deg2rad(rng.uniform(-1.0, 1.0, n) * grade),
        payload=np.deg2rad(rng.uniform(-1.0, 1.0, n) * grade),
        backlash=rng.uniform(0.0, 5e-5 + 2.5e-3 * grade, n),
        noise=10.0 ** rng.uniform(-6.5, -5.0 + 1.3 * grade, n),
        quantum=rng.choice(np.array([0.0, 1e-6, 1.534e-5, 1e-4, 2 * np.pi / 4096 * grade]), n),
        jitter=float(rng.choice([0.0, 0.1, 0.25])),
        loss=float(rng.choice([0.0, 0.0, 0.02])),
    )


def commands(rng: np.random.Generator, times: Array, n: int) -> Array:
    """Commanded motion, shape (K, n): moves, dwells, joints that rest, creep, reversals, steps.

    Parameters
    ----------
    times : ndarray, shape (K,), s, growing
    """
    out = np.empty((len(times), n))
    q = rng.uniform(-0.5, 0.5, n)
    t, k = times[0], 0
    while k < len(times):
        kind = rng.choice(['move', 'move', 'move', 'dwell', 'creep', 'swing'])
        goal = np.where(rng.random(n) < 0.7, rng.uniform(-1.5, 1.5, n), q)
        if kind == 'move':
            speed = 10.0 ** rng.uniform(-1.3, 0.2)  # rad/s, of the fastest joint
            length = max(float(np.abs(goal - q).max()) * 1.875 / speed, 0.3)
        elif kind == 'creep':
            goal = q + rng.uniform(-1.0, 1.0, n) * (rng.random(n) < 0.5) * 0.02
            length = rng.uniform(5.0, 15.0)
        elif kind == 'swing':
            length = rng.uniform(3.0, 8.0)
        else:
            goal, length = q, rng.uniform(0.5, 10.0)
        end = min(int(np.searchsorted(times, t + length)), len(times))
        s = ((times[k:end] - t) / length)[:, None]
        if kind == 'swing':
            # Back and forth through reversals at zero speed, each joint in its own rhythm.
            height = np.where(rng.random(n) < 0.7, rng.uniform(0.01, 0.4, n), 0.0)
            turns = rng.integers(1, 5, n)
            out[k:end] = q + height * (1.0 - np.cos(2.0 * np.pi * turns * s)) / 2.0
            goal = q
        elif kind == 'creep':
            out[k:end] = q + (goal - q) * s
        else:
            out[k:end] = q + (goal - q) * s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
        q, t, k = goal, t + length, max(end, k + 1) if end == k else end
    return out


@numba.njit(cache=True, nogil=True)
def _follow(times: Array, c: Array, delay: float, servo: float, play: float, q: Array) -> None:
    """Positions of one joint that follows ``c``; all arrays have shape (K,)."""
    drive = c[0]
    q[0] = c[0]
    at = 0
    for k in range(1, times.shape[0]):
        tau = times[k] - delay
        while at + 1 < k and times[at + 1] <= tau:
            at += 1
        wanted = c[0]
        if tau > times[0]:
            part = (tau - times[at]) / (times[at + 1] - times[at])
            wanted = c[at] + min(part, 1.0) * (c[at + 1] - c[at])
        drive += (wanted - drive) * (1.0 - np.exp(-(times[k] - times[k - 1]) / servo))
        # The output moves only once the drive has crossed the play.
        q[k] = min(max(q[k - 1], drive - 0.5 * play), drive + 0.5 * play)


def simulate(
    rng: np.random.Generator, arm: ArmModel, duration: float, *, start: float = 0.0
) -> tuple[Recording, Array]:
    """Healthy recording of ``duration`` s, and the true joint positions, shape (K, n)."""
    n = len(arm.delay)
    period = 1.0 / arm.rate
    ticks = np.arange(int(duration * arm.rate))
    times = start + period * (ticks + arm.jitter * rng.uniform(-0.5, 0.5, len(ticks)))
    times = times[rng.random(len(times)) >= arm.loss]
    wanted = commands(rng, times, n)
    truth = np.empty_like(wanted)
    for j in range(n):
        column = np.empty(len(times))
        _follow(
            times,
            np.ascontiguousarray(wanted[:, j]),
            arm.delay[j],
            arm.servo[j],
            arm.backlash[j],
            column,
        )
        truth[:, j] = column
    # A payload comes and goes within half a second.
    cycle = rng.uniform(20.0, 60.0)
    carried = 0.5 + 0.5 * np.tanh(0.7 * cycle * np.sin(2.0 * np.pi * times / cycle))
    truth = truth + arm.offset + arm.sag * np.sin(truth) + arm.payload * carried[:, None]
    readings = read_encoders(rng, arm, truth)
    speeds = filtered_velocity(times, readings)
    efforts = arm_effort(rng, times, truth)
    joints = tuple(f'joint_{j + 1}' for j in range(n))
    stamps = np.round(times * 1e9).astype(np.int64)
    present = np.ones(readings.shape, dtype=np.bool_)
    name = f'simulated {arm.rate:g} Hz'
    return Recording(name, joints, stamps, readings, speeds, efforts, wanted, present), truth


def read_encoders(rng: np.random.Generator, arm: ArmModel, truth: Array) -> Array:
    """Readings of true positions (K, n): noise, then quantisation."""
    readings = truth + arm.noise * rng.standard_normal(truth.shape)
    steps = np.where(arm.quantum > 0.0, arm.quantum, 1.0)
    return np.where(arm.quantum > 0.0, np.round(readings / steps) * steps, readings)


def filtered_velocity(times: Array, readings: Array) -> Array:
    """Velocities (K, n) as drivers report them: differences through a low-pass filter."""
    steps = np.diff(times, prepend=times[0] - 1.0)[:, None]
    raw = np.diff(readings, axis=0, prepend=readings[:1]) / steps
    return np.asarray(lfilter([0.05], [1.0, -0.95], raw, axis=0))


def arm_effort(rng: np.random.Generator, times: Array, truth: Array) -> Array:
    """Efforts (K, n): gravity, friction, inertia and noise."""
    speed = np.gradient(truth, times, axis=0)
    return np.asarray(
        10.0 * np.sin(truth) + 2.0 * np.tanh(50.0 * speed) + 0.2 * rng.standard_normal(truth.shape)
    )
