"""IK of RODs: microseconds and success beside the same LM on Pinocchio + NumPy, and SciPy."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import pinocchio
from numpy.typing import NDArray
from scipy.optimize import least_squares

from bench.pinocchio_lm import PinocchioLm
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.ik import solve_ik, solve_ik_batch
from ft_manip_ros.core.ik_settings import IkSettings
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.pinocchio_model import model_from_chain

PROBLEMS = 3000
# SciPy takes tens of milliseconds for each: it gets the first ones only.
SCIPY_PROBLEMS = 300
SEED = 20
SETTINGS = IkSettings(tolerance=1e-6)


@dataclass
class Problems:
    """Positions that the ROD can reach, with a cold start."""

    chain: SerialChain
    goals: list[Goal]
    targets: Array  # (N, 3)
    starts: Array  # (N, n), the frozen joint at its angle
    joints: NDArray[np.int64]  # (N,), which joint is frozen
    frozen: NDArray[np.bool_]  # (N, n)


def problems() -> Problems:
    """Draw the problems: one joint frozen at random, start and goal posture random."""
    chain = load_arm('paredis_table_3')
    rng = np.random.default_rng(SEED)
    postures = rng.uniform(chain.lower, chain.upper, (PROBLEMS, chain.n))
    starts = rng.uniform(chain.lower, chain.upper, (PROBLEMS, chain.n))
    joints = rng.integers(chain.n, size=PROBLEMS)
    rows = np.arange(PROBLEMS)
    starts[rows, joints] = postures[rows, joints]
    frozen = np.zeros((PROBLEMS, chain.n), dtype=bool)
    frozen[rows, joints] = True
    targets = fk(chain, postures)[1]
    return Problems(chain, [Goal(p) for p in targets], targets, starts, joints, frozen)


def reached(given: Problems, answers: Array) -> float:
    """Part of the answers that are at the goal, by Pinocchio, and inside the limits, in %."""
    model = model_from_chain(given.chain)
    data = model.createData()
    tool = model.nframes - 1
    good = 0
    for q, target in zip(answers, given.targets, strict=False):
        pinocchio.framesForwardKinematics(model, data, q)
        inside = (q >= given.chain.lower).all() and (q <= given.chain.upper).all()
        good += (
            bool(inside)
            and float(np.linalg.norm(data.oMf[tool].translation - target)) <= 1.0001e-6
        )
    return 100.0 * good / len(answers)


def ours(given: Problems, threads: int) -> tuple[float, Array, float]:
    """Seconds, answers and mean steps of the compiled kernels, best of some passes."""
    # Processor time where one thread works, so that a busy machine does not count.
    clock = time.process_time if threads == 1 else time.perf_counter
    best = np.inf
    for _ in range(8):
        begin = clock()
        batch = solve_ik_batch(
            given.chain,
            given.goals,
            starts=given.starts,
            frozen=given.frozen,
            settings=SETTINGS,
            threads=threads,
        )
        best = min(best, clock() - begin)
    return best, batch.q, float(batch.iterations.mean())


def ours_one_by_one(given: Problems) -> tuple[float, Array, float]:
    """As `ours`, through the Python call for one goal on a ROD built beforehand."""
    rods = [
        given.chain.freeze({given.chain.joint_names[j]: start[j]})
        for j, start in zip(given.joints, given.starts, strict=True)
    ]
    answers, steps, spent = given.starts.copy(), 0, 0.0
    for k, rod in enumerate(rods):
        assert rod.arrays is not None  # made once per ROD, as a re-planner would have it
        begin = time.process_time()
        result = solve_ik(
            rod, given.goals[k], start=given.starts[k, ~given.frozen[k]], settings=SETTINGS
        )
        spent += time.process_time() - begin
        answers[k, ~given.frozen[k]] = result.q
        steps += result.iterations
    return spent, answers, steps / PROBLEMS


def reduced_models(given: Problems) -> list[pinocchio.Model]:
    """Pinocchio's RODs; building them is not timed."""
    model = model_from_chain(given.chain)
    return [
        pinocchio.buildReducedModel(model, [int(j) + 1], start)
        for j, start in zip(given.joints, given.starts, strict=True)
    ]


def pinocchio_numpy(given: Problems) -> tuple[float, Array, float]:
    """Time the same LM on Pinocchio calls and NumPy."""
    rng = np.random.default_rng(SEED)
    answers, steps, spent = given.starts.copy(), 0, 0.0
    for k, model in enumerate(reduced_models(given)):
        solver = PinocchioLm(model, SETTINGS.tolerance, SETTINGS.max_iterations, SETTINGS.restarts)
        free = ~given.frozen[k]
        begin = time.process_time()
        _, q, taken = solver.solve(given.starts[k, free], given.targets[k], rng)
        spent += time.process_time() - begin
        answers[k, free] = q
        steps += taken
    return spent, answers, steps / PROBLEMS


def scipy_least_squares(given: Problems) -> tuple[float, Array, float]:
    """Time SciPy's bounded least squares with Pinocchio's Jacobian, restarted alike."""
    rng = np.random.default_rng(SEED)
    answers, evaluations, spent = given.starts[:SCIPY_PROBLEMS].copy(), 0, 0.0
    for k, model in enumerate(reduced_models(given)[:SCIPY_PROBLEMS]):
        solver = PinocchioLm(model, SETTINGS.tolerance, 1, 0)
        free = ~given.frozen[k]
        target, start = given.targets[k], given.starts[k, free]
        begin = time.process_time()
        for _ in range(SETTINGS.restarts + 1):
            found = least_squares(
                lambda q, solver=solver, target=target: solver.position(q) - target,
                start,
                lambda q, solver=solver: solver.linear_jacobian(q),
                bounds=(solver.lower, solver.upper),
            )
            evaluations += found.nfev
            if np.sqrt(2.0 * found.cost) <= SETTINGS.tolerance:
                break
            start = rng.uniform(solver.lower, solver.upper)
        spent += time.process_time() - begin
        answers[k, free] = found.x
    return spent, answers, evaluations / SCIPY_PROBLEMS


def run() -> None:
    """Print the table."""
    given = problems()
    # Compile before anything is timed.
    solve_ik(given.chain, given.goals[0])
    rows = {
        'ft_manip_ros, batch, 1 thread': ours(given, 1),
        'ft_manip_ros, batch, 2 threads': ours(given, 2),
        'ft_manip_ros, one call each': ours_one_by_one(given),
        'same LM, Pinocchio + NumPy': pinocchio_numpy(given),
        f'SciPy least_squares, first {SCIPY_PROBLEMS}': scipy_least_squares(given),
    }
    seconds, answers, _ = rows['ft_manip_ros, batch, 1 thread']
    fastest = seconds / len(answers)
    print(
        f'Position IK of the ROD, paredis_table_3, {PROBLEMS} problems (seed {SEED}), one joint '
        f'frozen, cold start, {SETTINGS.tolerance:g} m; processor time (2 threads: wall time)'
    )
    print(f'{"":34}{"us/solve":>10}{"ratio":>9}{"success %":>11}{"steps":>8}')
    for name, (seconds, answers, steps) in rows.items():
        print(
            f'{name:34}{seconds / len(answers) * 1e6:10.2f}{seconds / len(answers) / fastest:9.1f}'
            f'{reached(given, answers):11.2f}{steps:8.1f}'
        )
