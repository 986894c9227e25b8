"""FTWS certificates: how many of the engine's proofs the independent verifier confirms."""

from __future__ import annotations

import time
from collections import Counter

import numpy as np

from bench.ftws_arms import limited, planar, random_arm
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.ftws.certificate import certify, verify
from ft_manip_ros.core.ftws.settings import FtwsSettings

SETTINGS = FtwsSettings(intervals=False)


class Tally:
    """Confirmed and rejected verdicts of one kind of question."""

    def __init__(self) -> None:
        self.counts: Counter[tuple[str, bool]] = Counter()
        self.judging = self.verifying = 0.0
        self.rejected: list[str] = []

    def add(
        self, chain: SerialChain, points: Array, order: int = 1, mode: str = 'position'
    ) -> None:
        """Certify and verify points."""
        begin = time.process_time()
        results, document = certify(chain, points, order=order, mode=mode, settings=SETTINGS)
        middle = time.process_time()
        for result, (confirmed, text) in zip(results, verify(document), strict=True):
            self.counts[result.verdict.value, confirmed] += 1
            if not confirmed:
                self.rejected.append(f'{chain.name} {result.point}: {text}')
        self.judging += middle - begin
        self.verifying += time.process_time() - middle

    def show(self, name: str) -> None:
        """Print one line, and what was rejected."""
        asked = max(sum(self.counts.values()), 1)
        words = []
        for verdict in ('member', 'non_member'):
            right, wrong = self.counts[verdict, True], self.counts[verdict, False]
            words.append(f'{right:4d} of {right + wrong:4d}')
        print(
            f'{name:<34} {words[0]:>13} {words[1]:>16} {self.counts["undecided", True]:8d} '
            f'{self.judging / asked * 1e3:11.1f} {self.verifying / asked * 1e3:11.1f}',
            flush=True,
        )
        for text in self.rejected:
            print(f'    not confirmed: {text}', flush=True)


def run() -> None:
    """Print one line for each kind of question."""
    print(
        'confirmed by the verifier           members      non-members  undecided'
        '   ms to judge   to verify (CPU, a point)'
    )
    rng = np.random.default_rng(0)
    tally = Tally()
    tally.add(
        load_arm('paredis_table_3'), np.array([[0.5, 0, 0.5], [0, 0.5, 0.25], [0.75, 0, 0.5]])
    )
    tally.show('Table 3, the points of eq. 11')
    tally = Tally()
    tally.add(load_arm('paredis_table_3'), rng.uniform(-0.8, 0.8, (60, 3)))
    tally.show('Table 3')
    for degrees in (180.0, 170.0, 160.0):
        tally = Tally()
        tally.add(limited('paredis_table_1', degrees), rng.uniform(-1.6, 1.6, (60, 3)))
        tally.show(f'Table 1 at ±{degrees:g}°')
    tally = Tally()
    for _ in range(60):
        chain = random_arm(rng, int(rng.integers(4, 8))).chain()
        tally.add(chain, _directions(rng, 4) * 0.3 * float(_reach(chain)))
    tally.show('random arms, 4 to 7 joints')
    for order in (2, 3, 4):
        tally = Tally()
        points = rng.uniform(-1.6, 1.6, (60, 3)) * [1.0, 1.0, 0.0]
        tally.add(planar(*[1.0] * (2 * order + 2)), points, order=order)
        tally.show(f'order {order}, planar {2 * order + 2}R')
    for order in (1, 2, 3):
        tally = Tally()
        poses = np.zeros((30, 7))
        poses[:, :2] = rng.uniform(-1.6, 1.6, (30, 2))
        angle = rng.uniform(-np.pi, np.pi, 30)
        poses[:, 5], poses[:, 6] = np.sin(angle / 2), np.cos(angle / 2)
        tally.add(planar(*[1.0] * (2 * order + 2), 0.0), poses, order=order, mode='pose')
        tally.show(f'order {order}, poses of planar {2 * order + 3}R')


def _directions(rng: np.random.Generator, count: int) -> Array:
    """Random vectors (N, 3) of length 0.3 to 1.7."""
    rows = rng.normal(size=(count, 3))
    lengths: Array = rng.uniform(0.3, 1.7, (count, 1)) / np.linalg.norm(
        rows, axis=1, keepdims=True
    )
    scaled: Array = rows * lengths
    return scaled


def _reach(chain: SerialChain) -> float:
    """Sum of the links (m)."""
    return float(np.linalg.norm(chain.translations[1:], axis=1).sum())
