"""FK, Jacobian, isotropy and RODs against Pinocchio and finite differences, on random chains."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest

from ft_manip_ros.core.kinematics import fk, isotropy, jacobian
from ft_manip_ros.core.pinocchio_model import TOOL_FRAME, model_from_chain
from support.chains import random_chain, random_posture

CHAINS = 1000
BLOCKS = 10
TIGHT = 1e-12


def _reference(model: pinocchio.Model, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    data = model.createData()
    tool = model.getFrameId(TOOL_FRAME)
    frame = pinocchio.LOCAL_WORLD_ALIGNED
    # A single column comes back as a vector.
    columns = pinocchio.computeFrameJacobian(model, data, q, tool, frame).reshape(6, -1)
    pinocchio.framesForwardKinematics(model, data, q)
    return data.oMf[tool].rotation.copy(), data.oMf[tool].translation.copy(), columns


@pytest.mark.parametrize('block', range(BLOCKS))
def test_fk_jacobian_and_isotropy_agree_with_pinocchio(block: int) -> None:
    rng = np.random.default_rng([block, 11])
    for _ in range(CHAINS // BLOCKS):
        chain = random_chain(rng)
        q = random_posture(chain, rng)
        rotation, position, columns = _reference(model_from_chain(chain), q)
        ours_rotation, ours_position = fk(chain, q)
        assert np.abs(ours_rotation - rotation).max() < TIGHT
        assert np.abs(ours_position - position).max() < TIGHT
        assert np.abs(jacobian(chain, q) - columns).max() < TIGHT
        if chain.n >= 3:
            gram = columns[:3] @ columns[:3].T
            eigenvalues = np.maximum(np.linalg.eigvalsh(gram), 0.0)
            expected = np.cbrt(eigenvalues.prod()) / eigenvalues.mean()
            # The cube root of a rounding error is what a singular posture may differ by.
            assert isotropy(jacobian(chain, q)[:3]) == pytest.approx(expected, abs=2e-5)


def test_jacobian_is_the_derivative_of_fk() -> None:
    rng = np.random.default_rng(12)
    step = 1e-6
    for _ in range(100):
        chain = random_chain(rng)
        q = random_posture(chain, rng)
        columns = jacobian(chain, q)
        rotation, _ = fk(chain, q)
        for i in range(chain.n):
            ahead, behind = q.copy(), q.copy()
            ahead[i] += step
            behind[i] -= step
            (r_ahead, p_ahead), (r_behind, p_behind) = fk(chain, ahead), fk(chain, behind)
            linear = (p_ahead - p_behind) / (2 * step)
            spin = (r_ahead - r_behind) / (2 * step) @ rotation.T
            angular = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
            assert np.abs(columns[:3, i] - linear).max() < 1e-8
            assert np.abs(columns[3:, i] - angular).max() < 1e-8


def test_batches_give_what_single_postures_give() -> None:
    rng = np.random.default_rng(13)
    chain = random_chain(rng, joints=6)
    qs = np.array([random_posture(chain, rng) for _ in range(50)])
    rotations, positions = fk(chain, qs)
    columns = jacobian(chain, qs)
    for k, q in enumerate(qs):
        rotation, position = fk(chain, q)
        assert (rotations[k] == rotation).all()
        assert (positions[k] == position).all()
        assert (columns[k] == jacobian(chain, q)).all()


@pytest.mark.parametrize('block', range(5))
def test_any_set_of_frozen_joints_agrees_with_build_reduced_model(block: int) -> None:
    rng = np.random.default_rng([block, 14])
    for _ in range(40):
        chain = random_chain(rng, joints=int(rng.integers(2, 9)))
        q = random_posture(chain, rng)
        # At least one joint frozen, at least one left.
        count = int(rng.integers(1, chain.n))
        frozen = sorted(rng.choice(chain.n, size=count, replace=False).tolist())
        # A lock may also happen outside the limits.
        q[frozen] += rng.normal(size=count)
        model = model_from_chain(chain)
        ids = [model.getJointId(chain.joint_names[i]) for i in frozen]
        reduced = pinocchio.buildReducedModel(model, ids, q)
        rod = chain.freeze({chain.joint_names[i]: q[i] for i in frozen})
        kept = [i for i in range(chain.n) if i not in frozen]
        assert rod.joint_names == tuple(reduced.names)[1:]
        assert rod.frozen == {chain.joint_names[i]: q[i] for i in frozen}
        rotation, position, columns = _reference(reduced, q[kept])
        assert np.abs(fk(rod, q[kept])[0] - rotation).max() < TIGHT
        assert np.abs(fk(rod, q[kept])[1] - position).max() < TIGHT
        assert np.abs(jacobian(rod, q[kept]) - columns).max() < TIGHT
        # And with the same columns of the whole arm.
        assert np.abs(jacobian(chain, q)[:, kept] - columns).max() < TIGHT


def test_freezing_one_by_one_is_freezing_together() -> None:
    rng = np.random.default_rng(15)
    for _ in range(20):
        chain = random_chain(rng, joints=5)
        q = random_posture(chain, rng)
        together = chain.freeze({'joint_1': q[1], 'joint_3': q[3]})
        apart = chain.freeze({'joint_3': q[3]}).freeze({'joint_1': q[1]})
        assert together.frozen == apart.frozen
        for a, b in zip(fk(together, q[[0, 2, 4]]), fk(apart, q[[0, 2, 4]]), strict=True):
            assert np.abs(a - b).max() < TIGHT


def test_everything_frozen_leaves_one_place() -> None:
    rng = np.random.default_rng(16)
    chain = random_chain(rng, joints=4)
    q = random_posture(chain, rng)
    rod = chain.freeze(dict(zip(chain.joint_names, q, strict=True)))
    assert rod.n == 0
    for a, b in zip(fk(rod, np.zeros(0)), fk(chain, q), strict=True):
        assert np.abs(a - b).max() < TIGHT
