"""The DH kernels against the chain's kinematics, scipy's rotations and finite differences."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ft_manip_ros.core.design.dh_kernels import (
    AXIS,
    COLUMN,
    ERROR,
    GRADIENT,
    HESSIAN,
    ORIGIN,
    POSE,
    POSITION,
    ROTATION,
    VECTORS,
    Goals,
    Limits,
    dh_gradient,
    frames,
    jacobian_columns,
    make_rows,
    make_work,
    tool_error,
)
from ft_manip_ros.core.design.penalty import derivatives, isotropy, penalty
from ft_manip_ros.core.kinematics import isotropy as reference_isotropy
from support.dense_reach import dh_frame


def random_table(rng, n=6):
    return rng.uniform(-1, 1, n), rng.uniform(-1, 1, n), rng.uniform(-np.pi, np.pi, n)


def random_goals(rng, mode):
    rotation = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    return Goals(rng.uniform(-1, 1, (1, 3)), rotation[None].copy(), np.array([mode]))


def limits(n, width):
    bound = np.full(n, width)
    return Limits(-bound, bound, np.ones(n, dtype=bool), -bound, bound)


def test_frames_are_the_product_of_the_dh_matrices():
    rng = np.random.default_rng(0)
    for _ in range(50):
        table, q = random_table(rng), rng.uniform(-np.pi, np.pi, 6)
        work = make_work(6)
        frames(make_rows(*table), q, work)
        expected = dh_frame(*table, q)
        np.testing.assert_allclose(work[ROTATION, :3, :3], expected[:3, :3], atol=1e-13)
        np.testing.assert_allclose(work[ORIGIN, 6, :3], expected[:3, 3], atol=1e-13)


@pytest.mark.parametrize('mode', [POSITION, POSE, AXIS])
def test_the_tool_error_is_distance_and_angle(mode):
    rng = np.random.default_rng(1)
    for _ in range(50):
        table, q = random_table(rng), rng.uniform(-np.pi, np.pi, 6)
        goals, work = random_goals(rng, mode), make_work(6)
        frames(make_rows(*table), q, work)
        found = tool_error(goals, 0, work)
        tool = dh_frame(*table, q)
        expected = np.sum((tool[:3, 3] - goals.positions[0]) ** 2)
        if mode == POSE:
            turn = Rotation.from_matrix(tool[:3, :3] @ goals.orientations[0].T)
            np.testing.assert_allclose(work[VECTORS, ERROR, 3:6], turn.as_rotvec(), atol=1e-9)
            expected += turn.magnitude() ** 2
        elif mode == AXIS:
            cosine = tool[:3, 2] @ goals.orientations[0][:, 2]
            expected += np.arccos(np.clip(cosine, -1, 1)) ** 2
        np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize('mode', [POSITION, POSE, AXIS])
def test_derivatives_agree_with_finite_differences(mode):
    rng = np.random.default_rng(2)
    free = np.array([0, 1, 3, 4, 5])
    bounds = limits(6, 1.0)
    for _ in range(20):
        rows, goals, work = make_rows(*random_table(rng)), random_goals(rng, mode), make_work(6)
        q = rng.uniform(-2, 2, 6)

        def half(values, rows=rows, goals=goals, work=work):
            return 0.5 * penalty(rows, goals, 0, bounds, free, values, work)

        def gradient(values, half=half, goals=goals, work=work):
            half(values)
            derivatives(goals, 0, free, True, work)
            return work[VECTORS, GRADIENT, :5].copy(), work[HESSIAN, :5, :5].copy()

        found, hessian = gradient(q)
        for k, j in enumerate(free):
            step = np.zeros(6)
            step[j] = 1e-6
            expected = (half(q + step) - half(q - step)) / 2e-6
            assert found[k] == pytest.approx(expected, abs=1e-7)
            if mode == POSITION:
                column = (gradient(q + step)[0] - gradient(q - step)[0]) / 2e-6
                np.testing.assert_allclose(hessian[:, k], column, atol=1e-6)


@pytest.mark.parametrize('mode', [POSITION, POSE, AXIS])
def test_dh_gradient_agrees_with_finite_differences(mode):
    rng = np.random.default_rng(3)
    for _ in range(20):
        p, q = np.concatenate(random_table(rng)), rng.uniform(-2, 2, 6)
        goals, work, found = random_goals(rng, mode), make_work(6), np.zeros(18)

        def half(p, q=q, goals=goals, work=work):
            frames(make_rows(p[:6], p[6:12], p[12:]), q, work)
            return 0.5 * tool_error(goals, 0, work)

        half(p)
        dh_gradient(mode, work, found)
        for i in range(18):
            step = np.zeros(18)
            step[i] = 1e-6
            expected = (half(p + step) - half(p - step)) / 2e-6
            assert found[i] == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize('mode', [POSITION, POSE])
def test_isotropy_is_equation_9(mode):
    rng = np.random.default_rng(4)
    m = 3 if mode == POSITION else 6
    free = np.arange(7)
    for _ in range(20):
        goals, work = random_goals(rng, mode), make_work(7)
        frames(make_rows(*random_table(rng, 7)), rng.uniform(-2, 2, 7), work)
        jacobian_columns(mode, work)
        expected = reference_isotropy(work[COLUMN, :m, :7])
        assert isotropy(goals, 0, free, work) == pytest.approx(expected, rel=1e-9)


def test_a_straight_arm_has_no_isotropy():
    rows, work = make_rows(np.zeros(4), np.ones(4), np.zeros(4)), make_work(4)
    frames(rows, np.zeros(4), work)
    goals = Goals(np.zeros((1, 3)), np.eye(3)[None].copy(), np.array([POSITION]))
    assert isotropy(goals, 0, np.arange(4), work) == 0.0
