"""Forward kinematics and Jacobian: microseconds per posture beside Pinocchio."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pinocchio

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.kernels import fk_batch, jacobian_batch
from ft_manip_ros.core.kinematics import fk, jacobian
from ft_manip_ros.core.pinocchio_model import TOOL_FRAME, model_from_chain

POSTURES = 2000
PASSES = 20
PANDA = 'package://example-robot-data/robots/panda_description/urdf/panda.urdf'


def best(call: Callable[[], object]) -> float:
    """Microseconds per posture, best of some passes."""
    least = np.inf
    for _ in range(PASSES):
        begin = time.perf_counter()
        call()
        least = min(least, time.perf_counter() - begin)
    return least / POSTURES * 1e6


def table(chain: SerialChain) -> None:
    """Print the rows of one arm."""
    rng = np.random.default_rng(0)
    qs = rng.uniform(chain.lower, chain.upper, (POSTURES, chain.n))
    model = model_from_chain(chain)
    data = model.createData()
    tool = model.getFrameId(TOOL_FRAME)
    rotations, positions = np.empty((POSTURES, 3, 3)), np.empty((POSTURES, 3))
    columns = np.empty((POSTURES, 6, chain.n))

    def pinocchio_fk() -> None:
        for q in qs:
            pinocchio.framesForwardKinematics(model, data, q)

    def pinocchio_jacobian() -> None:
        for q in qs:
            pinocchio.computeJointJacobians(model, data, q)
            pinocchio.getFrameJacobian(model, data, tool, pinocchio.LOCAL_WORLD_ALIGNED)

    def one_by_one() -> None:
        for q in qs:
            jacobian(chain, q)

    rows: dict[str, tuple[Callable[[], object], str]] = {
        'FK, compiled batch': (
            lambda: fk_batch(chain.arrays, qs, rotations, positions),
            'FK',
        ),
        'FK, fk(chain, qs)': (lambda: fk(chain, qs), 'FK'),
        'FK, Pinocchio from Python': (pinocchio_fk, 'FK'),
        'FK + J, compiled batch': (
            lambda: jacobian_batch(chain.arrays, qs, rotations, positions, columns),
            'J',
        ),
        'FK + J, jacobian(chain, qs)': (lambda: jacobian(chain, qs), 'J'),
        'FK + J, jacobian(chain, q) each': (one_by_one, 'J'),
        'FK + J, Pinocchio from Python': (pinocchio_jacobian, 'J'),
    }
    print(f'{chain.name}, {chain.n} joints, {POSTURES} postures, one core')
    print(f'{"":34}{"us/posture":>12}{"ratio":>9}')
    first: dict[str, float] = {}
    for name, (call, kind) in rows.items():
        call()
        spent = best(call)
        ratio = spent / first.setdefault(kind, spent)
        print(f'{name:34}{spent:12.3f}{ratio:9.1f}')


def run() -> None:
    """Print a table for the paper's arm and for a real one."""
    table(load_arm('paredis_table_3'))
    print()
    table(load_arm(PANDA, base='panda_link0', tip='panda_link8'))
