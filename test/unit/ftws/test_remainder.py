"""Third derivatives and Taylor remainders of the task map, against SciPy and a power series."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ft_manip_ros.core.ftws.local_model import evaluate, hessian, make_model
from ft_manip_ros.core.ftws.remainder import beyond_line, third_along, third_order_bound
from ft_manip_ros.core.ftws.task_map import task_arrays
from support.chains import random_chain


def residual(chain, task, goal, q):
    """Task map of an arm in NumPy and SciPy; the error stays far below a half turn."""
    turn, place = np.eye(3), np.zeros(3)
    for i, joint in enumerate(chain.joints):
        place = place + turn @ chain.translations[i]
        turn = turn @ chain.rotations[i]
        if joint.prismatic:
            place = place + turn[:, 2] * q[i]
        else:
            c, s = np.cos(q[i]), np.sin(q[i])
            turn = turn @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    place = place + turn @ chain.translations[-1]
    position = task.position_rows @ (place - goal[:3])
    if len(task.orientation_rows) == 0:
        return position
    wanted = Rotation.from_quat(np.roll(goal[3:], -1))
    x, y, z, w = (Rotation.from_matrix(turn @ chain.rotations[-1]) * wanted.inv()).as_quat()
    error = 2.0 * np.sign(w) * np.array([x, y, z])
    return np.concatenate([position, task.length * task.orientation_rows @ error])


def made(seed, mode):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, joints=int(rng.integers(3, 8)))
    arrays, task = chain.arrays, task_arrays(chain, mode, None)
    q = rng.uniform(-0.5, 0.5, chain.n)
    goal = np.concatenate([rng.normal(size=3), [1.0, 0.0, 0.0, 0.0]])
    model = make_model(chain.n, 3 if mode == 'position' else 6)
    if mode == 'pose':
        # A goal near the tool, so that the error quaternion keeps its sign.
        evaluate(arrays, task, goal, q, model)
        near = Rotation.from_rotvec(rng.uniform(-0.4, 0.4, 3)) * Rotation.from_matrix(
            model.tip_rotation
        )
        x, y, z, w = near.as_quat()
        goal[3:] = w, x, y, z
    evaluate(arrays, task, goal, q, model)
    return rng, chain, arrays, task, goal, q, model


@pytest.mark.parametrize('mode', ['position', 'pose'])
def test_third_along_is_the_series_third_coefficient(mode):
    for seed in range(15):
        rng, chain, arrays, task, goal, q, model = made(seed, mode)
        d = rng.normal(size=chain.n)
        d /= np.abs(d).sum()
        out = np.zeros(model.residual.shape[0])
        third_along(arrays, task, model, d, out)
        times = np.cos(np.pi * (np.arange(21) + 0.5) / 21)
        values = [residual(chain, task, goal, q + t * d) for t in times]
        for row, values_of_row in enumerate(np.array(values).T):
            fit = np.polynomial.Polynomial.fit(times, values_of_row, 16, domain=[-1, 1])
            assert out[row] == pytest.approx(fit.deriv(3)(0.0), abs=1e-8)


@pytest.mark.parametrize('mode', ['position', 'pose'])
def test_beyond_line_bounds_what_the_expansion_leaves(mode):
    nearest = 0.0
    for seed in range(15):
        rng, chain, arrays, task, goal, q, model = made(seed, mode)
        m = model.residual.shape[0]
        tensor, third = np.zeros((m, chain.n, chain.n)), np.zeros(m)
        hessian(arrays, task, model, tensor)
        length = task.length if mode == 'pose' else 0.0
        start, jacobian = residual(chain, task, goal, q), model.jacobian.copy()
        for _ in range(40):
            line = rng.normal(size=chain.n) * (rng.random(chain.n) < 0.5) * rng.uniform(0, 0.3)
            rest = rng.normal(size=chain.n) * (rng.random(chain.n) < 0.5) * rng.uniform(0, 0.1)
            d = line + rest
            third_along(arrays, task, model, line, third)
            left = residual(chain, task, goal, q + d) - (
                start + jacobian @ d + 0.5 * np.einsum('aij,i,j', tensor, d, d) + third / 6.0
            )
            bound = beyond_line(
                arrays, model.distance, length, np.abs(line), np.abs(line) + np.abs(rest)
            )
            assert np.linalg.norm(left) <= bound * (1.0 + 1e-9) + 1e-12
            if bound > 1e-9:
                nearest = max(nearest, np.linalg.norm(left) / bound)
    assert nearest > 0.5  # no bound that holds by being large


@pytest.mark.parametrize('mode', ['position', 'pose'])
def test_along_the_line_itself_only_the_fourth_order_is_left(mode):
    for seed in range(10):
        rng, chain, arrays, task, *_, model = made(seed, mode)
        length = task.length if mode == 'pose' else 0.0
        line = rng.uniform(0.1, 1.0, chain.n) * 1e-3
        bounds = [
            beyond_line(arrays, model.distance, length, share * line, share * line)
            for share in (1.0, 0.5)
        ]
        assert bounds[1] == pytest.approx(bounds[0] / 16.0, rel=1e-2)
        whole = beyond_line(arrays, model.distance, length, 0.0 * line, line)
        third = third_order_bound(arrays, model.distance, length, line) / 6.0
        assert whole == pytest.approx(third, rel=2e-2)
