"""Sine and cosine of the kernels against mpmath; the twist form against the placements."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from numba import njit

from ft_manip_ros.core.dh import DhTable
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.joint import Joint
from ft_manip_ros.core.kernels import sin_cos
from ft_manip_ros.core.kinematics import fk, isotropy
from ft_manip_ros.core.screw_form import split_rotation
from support.chains import random_rotation


@njit
def _sin_cos(x: float) -> tuple[float, float]:
    return sin_cos(x)


def test_sine_and_cosine_are_right_to_two_units_in_the_last_place() -> None:
    rng = np.random.default_rng(1)
    quarter_turns = np.arange(-20, 21) * np.pi / 2
    values = np.concatenate(
        [
            rng.uniform(-10.0, 10.0, 2000),
            rng.uniform(-1e6, 1e6, 500),
            rng.uniform(1e6, 1e9, 50),
            quarter_turns,
            quarter_turns + 1e-9,
            np.nextafter(np.pi / 4, [0.0, 1.0]),
            [0.0, 1e-300, -1e-20],
        ]
    )
    with mpmath.workprec(200):
        for x in values:
            sine, cosine = _sin_cos(float(x))
            for ours, exact in ((sine, mpmath.sin(float(x))), (cosine, mpmath.cos(float(x)))):
                unit = np.spacing(abs(float(exact)))
                assert abs(mpmath.mpf(ours) - exact) <= 2.0 * unit, x


def test_sine_and_cosine_of_nan_and_infinity_are_nan() -> None:
    for x in (np.nan, np.inf, -np.inf):
        assert all(np.isnan(value) for value in _sin_cos(x))


def test_split_rotation_is_the_rotation() -> None:
    rng = np.random.default_rng(2)
    for _ in range(500):
        rotation = random_rotation(rng)
        a, cosine, sine, b = split_rotation(rotation)
        twist = np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
        made = _turn_z(a) @ twist @ _turn_z(b)
        assert np.abs(made - rotation).max() < 1e-14


def _turn_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def test_dh_rows_mean_rz_tz_tx_rx() -> None:
    rng = np.random.default_rng(3)
    joints = tuple(Joint(f'j{i}', -2.0, 2.0, prismatic=i == 2) for i in range(4))
    d, a, alpha, offset = rng.normal(size=(4, 4))
    chain = DhTable('arm', joints, d, a, alpha, offset).chain()
    q = rng.uniform(-2.0, 2.0, 4)
    frame = np.eye(4)
    for i in range(4):
        theta = offset[i] + (0.0 if joints[i].prismatic else q[i])
        slide = d[i] + (q[i] if joints[i].prismatic else 0.0)
        # The textbook matrix of one row.
        ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha[i]), np.sin(alpha[i])
        frame = frame @ np.array(
            [
                [ct, -st * ca, st * sa, a[i] * ct],
                [st, ct * ca, -ct * sa, a[i] * st],
                [0.0, sa, ca, slide],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )
    rotation, position = fk(chain, q)
    assert np.abs(rotation - frame[:3, :3]).max() < 1e-14
    assert np.abs(position - frame[:3, 3]).max() < 1e-14


def test_isotropy_of_known_matrices() -> None:
    assert isotropy(np.eye(3)) == pytest.approx(1.0)
    assert isotropy(np.diag([1.0, 2.0])) == pytest.approx(np.sqrt(4.0) / 2.5)
    assert isotropy(np.zeros((3, 5))) == 0.0
    assert isotropy(np.ones((2, 3))) == 0.0


@pytest.mark.parametrize('q', [[0.0], [0.0, np.nan, 0.0], [[0.0, 0.0]], [0.0, np.inf, 0.0]])
def test_malformed_postures_are_refused(q: list[float]) -> None:
    joints = tuple(Joint(f'j{i}') for i in range(3))
    chain = DhTable('arm', joints, np.zeros(3), np.ones(3), np.zeros(3), np.zeros(3)).chain()
    with pytest.raises(InputError, match='q: '):
        fk(chain, q)
