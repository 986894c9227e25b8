"""The baseline of the IK benchmark really is the same method: it takes the same steps."""

from __future__ import annotations

import numpy as np
import pinocchio

from bench.pinocchio_lm import PinocchioLm
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.ik_kernels import descend
from ft_manip_ros.core.ik_settings import IkSettings, ik_control
from ft_manip_ros.core.ik_types import CONVERGED, POSITION, ik_work
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.pinocchio_model import model_from_chain
from support.chains import random_posture


def test_kernel_and_pinocchio_lm_walk_the_same_way() -> None:
    rng = np.random.default_rng(31)
    chain = load_arm('paredis_table_3')
    model = model_from_chain(chain)
    settings = IkSettings()
    converged = 0
    for _ in range(150):
        q, start = random_posture(chain, rng), random_posture(chain, rng)
        frozen = np.arange(chain.n) == int(rng.integers(chain.n))
        start[frozen] = q[frozen]
        target = fk(chain, q)[1]
        reduced = pinocchio.buildReducedModel(model, [int(np.argmax(frozen)) + 1], q)
        baseline = PinocchioLm(reduced, settings.tolerance, settings.max_iterations, 0)
        reached, answer, steps = baseline.descend(start[~frozen].copy(), target)
        status, ours, distance, _ = descend(
            chain.arrays,
            frozen,
            POSITION,
            target,
            np.eye(3),
            ik_control(settings),
            start,
            ik_work(chain.n, chain.n),
        )
        assert (status == CONVERGED) == reached
        assert ours == steps
        if reached:
            converged += 1
            assert distance <= settings.tolerance
            assert np.abs(start[~frozen] - answer).max() < 1e-6
    assert 50 < converged < 150
