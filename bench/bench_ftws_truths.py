"""FTWS truths at full scale: closed forms and what the paper says of limited arms."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from bench.ftws_arms import limited, planar
from ft_manip_ros.core.arm_file import load_dh
from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.dh import DhTable
from ft_manip_ros.core.ftws.query import query
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import FtwsResult, Verdict

VERDICT = FtwsSettings(intervals=False)
THREADS = 2


def run() -> None:
    """Print one line for each truth."""
    for check in (closed_form, limits, planar_truths, dextrous, margins, order_of_asking):
        begin = time.process_time()
        check()
        print(
            f'    ({check.__name__}: {time.process_time() - begin:.0f} s of CPU time)', flush=True
        )


def closed_form(total: int = 10_000) -> None:
    """Random points against the closed form of Table 1, a, b and scale at random."""
    rng = np.random.default_rng(0)
    wrong = undecided = 0
    shell = 0.0
    batch = 100
    for _ in range(total // batch):
        a, b = rng.uniform(-1.0, 1.0, 2)
        scale = rng.uniform(0.2, 5.0)
        table = load_dh('paredis_table_1')
        d = np.array([0.0, a, -a, b, -b])
        chain = (
            DhTable('random', table.joints, d, table.a, table.alpha, table.offset)
            .scaled(scale)
            .chain()
        )
        points = rng.uniform(-2.6, 2.6, (batch, 3)) * scale
        rho, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
        out = np.maximum(rho - 2.0 * scale, np.hypot(rho - scale, z) - 2.0 * scale) / scale
        for answer, distance in zip(
            query(chain, points, settings=VERDICT, threads=THREADS), out, strict=True
        ):
            if answer.verdict is Verdict.UNDECIDED:
                undecided += 1
                shell = max(shell, abs(distance))
            else:
                wrong += (answer.verdict is Verdict.MEMBER) != (distance <= 0.0)
    print(
        f'Table 1, {total} random points, a, b and scales: {wrong} contradict the closed form, '
        f'{undecided} undecided ({undecided / total:.3%}), the farthest {shell:.2g} (relative) '
        'from the boundary',
        flush=True,
    )


def limits() -> None:
    """Table 1 under limits on a half plane of 27 x 21 points: shrinks, hole, split, empty."""
    x, z = np.meshgrid(np.linspace(0.0, 2.6, 27), np.linspace(-2.0, 2.0, 21), indexing='ij')
    points = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=1)
    for degrees in (180.0, 170.0, 160.0, 155.0, 150.0):
        answers = query(
            limited('paredis_table_1', degrees), points, settings=VERDICT, threads=THREADS
        )
        count = [sum(a.verdict is v for a in answers) for v in Verdict]
        print(
            f'Table 1 at ±{degrees:g}°: {count[0]} members, {count[1]} non-members, '
            f'{count[2]} undecided of {len(points)}',
            flush=True,
        )


def planar_truths() -> None:
    """Discs and circles of planar arms with unit links; orders 1 and 2; equation 5."""
    rng = np.random.default_rng(1)
    for n, order, count in ((4, 1, 400), (6, 2, 12)):
        radius = np.sqrt(rng.uniform(0.0, 9.0, count))
        wrong, undecided = _against(planar(*[1.0] * n), order, radius, radius <= 2.0, rng)
        print(
            f'planar {n}R, order {order}, disc of radius 2: {wrong} wrong, {undecided} undecided'
        )
    radius = rng.uniform(0.0, 3.5, 200)
    off = np.abs(radius - 1.0) > 1e-5
    wrong, undecided = _against(planar(1, 1, 1), 1, radius[off], np.zeros(off.sum(), bool), rng)
    on, _ = _against(planar(1, 1, 1), 1, np.ones(40), np.ones(40, bool), rng)
    print(
        f'planar 3R: {wrong} members and {undecided} undecided of {off.sum()} points off r = 1, '
        f'{on} of 40 on it refuted',
        flush=True,
    )
    # Equation 5: the 4R arm's pose with a last link of no length, any angle: the disc of radius 2.
    poses = np.zeros((60, 7))
    radius = np.sqrt(rng.uniform(0.0, 9.0, 60))
    turn, angle = rng.uniform(-np.pi, np.pi, (2, 60))
    poses[:, 0], poses[:, 1] = radius * np.cos(turn), radius * np.sin(turn)
    poses[:, 5], poses[:, 6] = np.sin(angle / 2), np.cos(angle / 2)
    answers = query(planar(1, 1, 1, 1, 0), poses, mode='pose', settings=VERDICT, threads=THREADS)
    wrong, undecided = _count(answers, radius <= 2.0)
    print(f'planar 5R poses, equation 5: {wrong} wrong, {undecided} undecided of 60', flush=True)


def _against(
    chain: SerialChain,
    order: int,
    radius: Array,
    inside: NDArray[np.bool_],
    rng: np.random.Generator,
) -> tuple[int, int]:
    angle = rng.uniform(-np.pi, np.pi, len(radius))
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * radius], axis=1)
    return _count(query(chain, points, order=order, settings=VERDICT, threads=THREADS), inside)


def _count(answers: list[FtwsResult], inside: NDArray[np.bool_]) -> tuple[int, int]:
    """Answers that contradict the truth, and undecided ones."""
    expected = [Verdict.MEMBER if value else Verdict.NON_MEMBER for value in inside]
    undecided = sum(answer.verdict is Verdict.UNDECIDED for answer in answers)
    equal = sum(a.verdict is v for a, v in zip(answers, expected, strict=True))
    return len(answers) - undecided - equal, undecided


def dextrous() -> None:
    """Table 2 in every orientation: evidence at points inside the template, refutation outside."""
    points = np.array([[1.0, 0.0, 0.0], [0.5, 0.5, 0.5], [1.3, 0.0, -1.9], [3.0, 0.0, 0.0]])
    for answer in query(load_dh('paredis_table_2').chain(), points, mode='dextrous'):
        print(f'Table 2 at {answer.point}: {answer.verdict.value}: {answer.reason}', flush=True)


def margins() -> None:
    """Members beside joint limits and their proved balls."""
    rng = np.random.default_rng(5)
    settings = FtwsSettings(intervals=False, margin=True)
    for arm, degrees, span in (('paredis_table_3', 150.0, 0.8), ('paredis_table_1', 170.0, 1.5)):
        points = rng.uniform(-span, span, (60, 3))
        answers = query(limited(arm, degrees), points, settings=settings, threads=THREADS)
        balls = np.array([a.margin for a in answers if a.verdict is Verdict.MEMBER])
        print(
            f'{arm} at ±{degrees:g}°: {len(balls)} members, {(balls > 0.0).sum()} with a proved '
            f'ball, smallest {balls.min() * 1e3:.2g} mm, median {np.median(balls) * 1e3:.2g} mm',
            flush=True,
        )


def order_of_asking(total: int = 300) -> None:
    """The same answers for one and two threads, and backwards."""
    chain = limited('paredis_table_1', 170.0)
    points = np.random.default_rng(2).uniform(-2.0, 2.0, (total, 3))

    def asked(rows: Array, threads: int) -> list[tuple[object, ...]]:
        answers = query(chain, rows, settings=VERDICT, threads=threads)
        return [(a.verdict, a.joints, a.angles, a.residual, a.margin) for a in answers]

    one, two, back = asked(points, 1), asked(points, 2), asked(points[::-1], 2)[::-1]
    print(f'{total} points: two threads agree: {one == two}, backwards: {one == back}')
