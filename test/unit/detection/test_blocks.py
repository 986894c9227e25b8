"""Many samples at once come to what one after the other does, to the last bit."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.detection.feed import MonitorFeed
from ft_manip_ros.core.detection.monitor import FaultMonitor

CHAIN = load_arm('paredis_table_3')
NAMES = ('other', *reversed(CHAIN.joint_names))
RATE, COUNT = 100, 900
SECOND = 1_000_000_000

Change = Callable[[dict[str, np.ndarray]], None]


def locked(data: dict[str, np.ndarray]) -> None:
    data['positions'][400:, 2] = data['positions'][400, 2]


def nonsense(data: dict[str, np.ndarray]) -> None:
    data['positions'][300:450, 1] = np.nan
    data['positions'][600, 3] = 1e9


def back_in_time(data: dict[str, np.ndarray]) -> None:
    data['stamps'][500:] -= 3 * SECOND


def unordered(data: dict[str, np.ndarray]) -> None:
    data['stamps'][100:102] = data['stamps'][[101, 100]]
    data['stamps'][300] = data['stamps'][299]


def unstamped(data: dict[str, np.ndarray]) -> None:
    data['stamps'][:] = 0


def stamped_at_times(data: dict[str, np.ndarray]) -> None:
    data['stamps'][[0, 1, 250]] = 0


def without_speeds(data: dict[str, np.ndarray]) -> None:
    data['velocities'] = np.empty((COUNT, 0))


@pytest.mark.parametrize(
    'change',
    [locked, nonsense, back_in_time, unordered, unstamped, stamped_at_times, without_speeds],
)
@pytest.mark.parametrize('referenced', [False, True])
def test_blocks_are_single_samples(change: Change, referenced: bool) -> None:
    rng = np.random.default_rng(5)
    t = np.arange(COUNT) / RATE
    wave = 0.4 * np.sin(t[:, None] * np.linspace(0.5, 1.5, len(NAMES)))
    data = {
        'stamps': (10**18 + np.round(t * SECOND)).astype(np.int64),
        'positions': wave + 1e-5 * rng.standard_normal(wave.shape),
        'velocities': np.gradient(wave, 1.0 / RATE, axis=0),
        'efforts': np.empty((COUNT, 0)),
    }
    arrivals = data['stamps'] + 700_000
    change(data)
    feeds = [MonitorFeed(FaultMonitor(CHAIN.joints)) for _ in range(2)]
    found: list[list[object]] = [[], []]
    step = 50
    for start in range(0, COUNT, step):
        rows = range(start, start + step)
        for feed in feeds:
            if referenced:
                for k in rows:
                    feed.reference(int(arrivals[k]) - 700_000, int(arrivals[k]), NAMES, wave[k])
            elif start % 200 == 0:
                points = [
                    (float(t[k] - t[start]), wave[k], (), ())
                    for k in range(start, min(start + 250, COUNT), 10)
                ]
                feed.trajectory(
                    int(arrivals[start]) - 700_000, int(arrivals[start]), NAMES, points
                )
        for k in rows:
            found[0] += feeds[0].joint_state(
                int(data['stamps'][k]),
                int(arrivals[k]),
                NAMES,
                *(data[key][k].tolist() for key in ('positions', 'velocities', 'efforts')),
            )
        found[1] += feeds[1].joint_states(
            data['stamps'][start : start + step],
            arrivals[start : start + step],
            NAMES,
            *(data[key][start : start + step] for key in ('positions', 'velocities', 'efforts')),
        )
    assert [str(edge) for edge in found[0]] == [str(edge) for edge in found[1]]
    assert found[0]
    for one, many in zip(*(feed.monitor.records for feed in feeds), strict=True):
        assert one.tobytes() == many.tobytes()
