"""Fault monitor: cost per message, found faults, latency, false alarms, beside a fixed threshold.

Real recordings are judged where FT_MANIP_TELEMETRY names a folder with them.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from ft_manip_ros.core.detection.evaluate import evaluate
from ft_manip_ros.core.detection.monitor import FaultMonitor
from ft_manip_ros.core.detection.offline import detect
from ft_manip_ros.core.detection.recording import Recording
from ft_manip_ros.core.detection.simulate import ArmModel, random_arm, simulate
from ft_manip_ros.core.detection.telemetry import load_folder
from ft_manip_ros.core.detection.warm_up import warm_up

MESSAGES = 5000
HOURS = 24.0
PIECE = 600.0  # s of simulation at a time; each piece is another arm
FAST_PIECE = 60.0  # s, of arms above 250 Hz
TRIALS = 10


def precise_arm(n: int, rate: float) -> ArmModel:
    """A well-tuned arm: 8 ms of lag, 10 urad of noise, 15 urad encoder steps."""
    ones = np.ones(n)
    return ArmModel(
        rate=rate,
        delay=0.004 * ones,
        servo=0.004 * ones,
        offset=0.0 * ones,
        sag=1e-4 * ones,
        payload=0.0 * ones,
        backlash=5e-5 * ones,
        noise=1e-5 * ones,
        quantum=1.534e-5 * ones,
    )


def cost() -> None:
    """Print the time that one joint-state message takes."""
    print('CPU time per joint-state message\n')
    print('joints   one message (us)   share of a core at 1 kHz   in blocks (us)')
    for n in (7, 30):
        rng = np.random.default_rng(n)
        recording, _ = simulate(rng, precise_arm(n, 1000.0), MESSAGES / 1000.0)
        monitor = FaultMonitor(recording.joints)
        rows = [
            (
                int(stamp),
                dict(zip(recording.joints, q, strict=True)),
                dict(zip(recording.joints, v, strict=True)),
                dict(zip(recording.joints, e, strict=True)),
                dict(zip(recording.joints, c, strict=True)),
            )
            for stamp, q, v, e, c in zip(
                recording.stamps,
                recording.positions.tolist(),
                recording.velocities.tolist(),
                recording.efforts.tolist(),
                recording.commands.tolist(),
                strict=True,
            )
        ]
        begin = time.process_time()
        for stamp, q, v, e, c in rows:
            monitor.command(stamp, c)
            monitor.sample(stamp, q, v, e)
        one = (time.process_time() - begin) / len(rows)
        begin = time.process_time()
        detect(recording)
        block = (time.process_time() - begin) / len(rows)
        print(f'{n:>6}{one * 1e6:>19.1f}{one * 1e3:>26.1%}{block * 1e6:>17.2f}')


def _piece(seed: int) -> tuple[float, Counter[str]]:
    rng = np.random.default_rng([seed, 24])
    arm = random_arm(rng)
    recording, _ = simulate(rng, arm, PIECE if arm.rate <= 250.0 else FAST_PIECE)
    counts: Counter[str] = Counter()
    for data, suffix in ((recording, ''), (_without_command(recording), ' without command')):
        _, edges = detect(data)
        counts.update(edge.report.state.name + suffix for edge in edges)
    return recording.duration / 3600.0, counts


def _without_command(recording: Recording) -> Recording:
    return replace(recording, commands=np.full_like(recording.commands, np.nan))


def quiet_hours() -> None:
    """Print what is said of many arms that never fail."""
    print(f'\n{HOURS:g} simulated hours without a failure, arms of every grade, 10 Hz to 1 kHz\n')
    hours, counts = 0.0, Counter[str]()
    begin = time.perf_counter()
    seed = 0
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        while hours < HOURS:
            batch = range(seed, seed + 16)
            for length, found in pool.map(_piece, batch):
                hours += length
                counts += found
            seed = batch.stop
    elapsed = time.perf_counter() - begin
    for suffix in ('', ' without command'):
        alarms = '  '.join(
            f'{name} {counts[name + suffix]}'
            for name in ('LOCKED', 'RUNAWAY', 'SENSOR', 'STALE', 'SLUGGISH', 'SUSPECT')
        )
        print(f'{hours:.1f} h{suffix:<17} {alarms}')
    print(f'({seed} arms, {hours * 3600.0 / elapsed:.0f} times real time)')


def simulated() -> None:
    """Print how implanted faults are found on simulated arms, by rate and then all together."""
    print('\nLocks implanted into a well-tuned simulated arm, by rate\n')
    print('   Hz      n   found     p50 ms   p99 ms   samples   bound p50   fixed: found   p50 ms')
    for rate in (10.0, 50.0, 100.0, 250.0, 1000.0):
        rng = np.random.default_rng(int(rate))
        recordings = [simulate(rng, precise_arm(6, rate), 60.0)[0] for _ in range(4)]
        result = evaluate(recordings, trials=TRIALS, seed=1, kinds=('noisy lock', 'lock'))
        row, fixed = result.kinds[0], result.fixed
        p50, p99 = np.percentile(row.latency, [50, 99]) * 1e3
        late = np.median(fixed.latency) * 1e3 if fixed.latency else np.nan
        print(
            f'{rate:>5.0f}{row.trials:>7}{row.rate:>8.4f}{p50:>11.0f}{p99:>9.0f}'
            f'{np.median(row.samples):>10.0f}{np.nanmedian(row.bound) * 1e3:>12.0f}'
            f'{fixed.rate:>15.3f}{late:>9.0f}'
        )
    print('\nFaults implanted into simulated arms of every grade\n')
    rng = np.random.default_rng(0)
    recordings = [simulate(rng, random_arm(rng), 60.0)[0] for _ in range(16)]
    print(evaluate(recordings, trials=TRIALS, seed=0).table())


def real() -> None:
    """Print the evaluation on real recordings."""
    folder = os.environ.get('FT_MANIP_TELEMETRY')
    if not folder:
        print('\nFT_MANIP_TELEMETRY is not set: no real recordings judged')
        return
    print('\nReal recordings\n')
    print(evaluate(load_folder(Path(folder)), trials=100, seed=0).table())


def run() -> None:
    """Print all tables."""
    warm_up()
    cost()
    real()
    simulated()
    quiet_hours()
