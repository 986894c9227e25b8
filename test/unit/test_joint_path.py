"""Joint paths: interpolation against scipy, and what is refused."""

import numpy as np
import pytest
from scipy.interpolate import BPoly, CubicHermiteSpline

from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.joint_path import JointPath

RNG = np.random.default_rng(11)
TIMES = np.cumsum(RNG.uniform(0.1, 0.7, 6)) - 0.1
Q, V, A = (RNG.normal(size=(6, 3)) for _ in range(3))
NAMES = ('a', 'b', 'c')
INSIDE = np.linspace(TIMES[0], TIMES[-1] - 1e-9, 137)


def sampled(path):
    states = [path.sample(t) for t in INSIDE]
    return np.array([q for q, _ in states]), np.array([v for _, v in states])


def test_positions_alone_are_joined_by_lines():
    q, v = sampled(JointPath(NAMES, TIMES, Q))
    expected = np.array([np.interp(INSIDE, TIMES, Q[:, i]) for i in range(3)]).T
    np.testing.assert_allclose(q, expected, atol=1e-12)
    np.testing.assert_allclose(v[0], (Q[1] - Q[0]) / (TIMES[1] - TIMES[0]), atol=1e-12)


def test_with_velocities_cubics_as_scipy():
    q, v = sampled(JointPath(NAMES, TIMES, Q, V))
    spline = CubicHermiteSpline(TIMES, Q, V)
    np.testing.assert_allclose(q, spline(INSIDE), atol=1e-9)
    np.testing.assert_allclose(v, spline(INSIDE, 1), atol=1e-8)


def test_with_accelerations_quintics_as_scipy():
    q, v = sampled(JointPath(NAMES, TIMES, Q, V, A))
    spline = BPoly.from_derivatives(TIMES, np.stack([Q, V, A], axis=1))
    np.testing.assert_allclose(q, spline(INSIDE), atol=1e-9)
    np.testing.assert_allclose(v, spline(INSIDE, 1), atol=1e-8)


def test_stands_still_before_and_after():
    path = JointPath(NAMES, TIMES, Q, V)
    for time, row in ((TIMES[0] - 1.0, 0), (TIMES[-1] + 1.0, -1)):
        q, v = path.sample(time)
        np.testing.assert_array_equal(q, Q[row])
        np.testing.assert_array_equal(v, 0.0)


def test_columns_follow_the_names():
    path = JointPath(NAMES, TIMES, Q, V).ordered(['c', 'a', 'b'])
    np.testing.assert_array_equal(path.positions, Q[:, [2, 0, 1]])
    assert path.velocities is not None
    np.testing.assert_array_equal(path.velocities, V[:, [2, 0, 1]])


@pytest.mark.parametrize('names', [['a', 'b'], ['a', 'b', 'd'], ['a', 'b', 'b']])
def test_other_joints_are_refused(names):
    with pytest.raises(InputError, match='each once'):
        JointPath(NAMES, TIMES, Q).ordered(names)


@pytest.mark.parametrize(
    ('arguments', 'field'),
    [
        ((np.zeros(0), np.zeros((0, 3))), 'no points'),
        ((np.array([0.0, 0.0]), Q[:2]), 'time_from_start'),
        ((np.array([-1.0, 0.0]), Q[:2]), 'time_from_start'),
        ((np.array([0.0, np.nan]), Q[:2]), 'time_from_start'),
        ((TIMES, Q[:, :2]), 'positions'),
        ((TIMES, np.where(Q > 1.0, np.nan, Q)), 'positions'),
        ((TIMES, Q, V[:3]), 'velocities'),
        ((TIMES, Q, np.full_like(V, np.inf)), 'velocities'),
        ((TIMES, Q, None, A), 'accelerations'),
    ],
)
def test_malformed_paths_are_refused_by_field(arguments, field):
    with pytest.raises(InputError, match=field):
        JointPath(NAMES, *arguments)
