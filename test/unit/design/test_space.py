"""The space of tables: bounds, fixed values, steps, ties, length."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ft_manip_ros.core.design.space import design_space
from ft_manip_ros.core.errors import InputError

OPTIONS = [
    {},
    {'alpha_step': np.pi / 4},
    {'family': 'symmetric'},
    {'max_length': 2.0},
    {'family': 'symmetric', 'alpha_step': np.pi / 12, 'max_length': 3.0},
    {'fixed': {'alpha_2': 0.5, 'd_1': 0.25}, 'bounds': {'a': (0.1, 0.4), 'a_3': (0.0, 0.0)}},
]


@pytest.mark.parametrize('options', OPTIONS)
@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 2**32 - 1))
def test_samples_neighbours_and_steps_are_admissible(options, seed):
    space = design_space(5, 0.9, **options)
    rng = np.random.default_rng(seed)
    p = space.sample(rng)
    for _ in range(5):
        assert space.admits(p)
        assert p[-1] == 0.0
        p = space.neighbour(p, 0.2, rng)
    moved = space.moved(p, rng.normal(size=space.size))
    assert space.admits(moved)


def test_neighbours_move_and_stay_near():
    space = design_space(5, 0.9)
    rng = np.random.default_rng(0)
    p = space.sample(rng)
    moves = np.array([space.neighbour(p, 0.02, rng) - p for _ in range(200)])
    assert (np.abs(moves) > 0).any(axis=1).all()
    assert np.median(np.abs(moves).max(axis=1) / space.span.max()) < 0.1
    # Every free parameter gets its turn.
    assert (np.abs(moves).sum(axis=0)[:-1] > 0).all()


def test_fixed_parameters_never_move():
    space = design_space(4, 1.0, fixed={'a_2': 0.3, 'alpha_1': 1.2})
    rng = np.random.default_rng(1)
    p = space.sample(rng)
    for _ in range(50):
        p = space.neighbour(p, 0.3, rng)
        assert p[4 + 1] == 0.3
        assert p[8] == 1.2


def test_symmetric_tables_read_the_same_from_both_ends():
    space = design_space(5, 1.0, family='symmetric')
    p = space.sample(np.random.default_rng(2))
    np.testing.assert_array_equal(p[:5], p[:5][::-1])
    np.testing.assert_array_equal(p[5:10], p[5:10][::-1])
    np.testing.assert_array_equal(p[10:14], p[10:14][::-1])


def test_alpha_comes_in_steps():
    space = design_space(5, 1.0, alpha_step=np.pi / 4)
    rng = np.random.default_rng(3)
    p = space.sample(rng)
    values = set()
    for _ in range(200):
        p = space.neighbour(p, 0.3, rng)
        steps = p[10:14] / (np.pi / 4)
        np.testing.assert_allclose(steps, np.round(steps), atol=1e-12)
        values |= set(np.round(steps).astype(int).tolist())
    assert len(values) >= 7
    assert set(space.movable(p, np.zeros(space.size))) == set(range(10))


def test_a_variable_at_its_bound_moves_only_inwards():
    space = design_space(3, 1.0)
    p = space.upper.copy()
    pushing = -np.ones(space.size)
    assert len(space.movable(p, pushing)) == 0
    assert len(space.movable(p, -pushing)) == space.size


def test_gradients_of_tied_parameters_add_up():
    space = design_space(3, 1.0, family='symmetric')
    row = np.zeros((1, 9))
    row[0, 0], row[0, 2] = 1.0, 2.0
    np.testing.assert_allclose(space.to_variables(row)[0, 0], 3.0 * space.span[0])


@pytest.mark.parametrize(
    ('options', 'field'),
    [
        ({'bounds': {'b': (0.0, 1.0)}}, "'b'"),
        ({'bounds': {'a_9': (0.0, 1.0)}}, "'a_9'"),
        ({'bounds': {'a': (1.0, 0.0)}}, 'bounds.a'),
        ({'bounds': {'a': (0.0, np.nan)}}, 'bounds.a'),
        ({'fixed': {'a_1': np.inf}}, 'fixed.a_1'),
        ({'fixed': {'alpha': 0.0, 'a': 1.0, 'd': 0.0}}, 'bounds'),
        ({'family': 'round'}, 'family'),
        ({'family': 'symmetric', 'bounds': {'a_1': (0.0, 0.1)}}, 'symmetric'),
        ({'alpha_step': -1.0}, 'alpha_step'),
        ({'alpha_step': np.nan}, 'alpha_step'),
        ({'max_length': 0.0}, 'max_length'),
        ({'max_length': np.nan}, 'max_length'),
    ],
)
def test_a_bad_space_is_named(options, field):
    with pytest.raises(InputError, match=field):
        design_space(4, 1.0, **options)
