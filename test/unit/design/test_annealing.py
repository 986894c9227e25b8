"""Equation 10: acceptance statistics, the threshold form, a chain that can be taken up again."""

import json

import numpy as np
import pytest

from ft_manip_ros.core.design.annealing import annealing_segment, first_temperature, threshold
from ft_manip_ros.core.design.problem import design_problem
from ft_manip_ros.core.design.segments import never
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.goal import DesignSpec
from ft_manip_ros.core.task_file import load_task

TASK = load_task('paredis_eq_11')


@pytest.mark.parametrize(('rise', 'temperature'), [(0.1, 0.2), (1.0, 0.5), (0.02, 0.02)])
def test_a_rise_is_accepted_as_often_as_equation_10_says(rise, temperature):
    draws = np.random.default_rng(0).random(20_000)
    accepted = [1.0 + rise <= threshold(1.0, temperature, u) for u in draws]
    assert np.mean(accepted) == pytest.approx(np.exp(-rise / temperature), abs=0.01)
    # The same decisions, one by one.
    assert accepted == [np.exp(-rise / temperature) >= u for u in draws]


def test_a_fall_is_always_accepted():
    for draw in (0.0, 1e-12, 0.5, 1.0 - 1e-12):
        assert threshold(1.0, 0.3, draw) >= 1.0
        assert threshold(1.0, 0.0, max(draw, 1e-12)) == 1.0


def test_the_first_temperature_accepts_nearly_everything():
    rises = np.array([0.5, -1.0, 1.5, 1.0])
    assert np.exp(-1.0 / first_temperature(rises, 0.9)) == pytest.approx(0.9)
    assert first_temperature(np.array([-1.0, 0.0])) > 0.0


@pytest.mark.parametrize('method', ['annealing', 'paredis_1994'])
def test_a_chain_goes_on_from_its_state_as_if_never_stopped(method):
    problem = design_problem(
        TASK, settings=DesignSettings(method=method, prove=False, angles=9, restarts=1)
    )
    state = None
    for index in range(2):
        # A state is plain enough for a file.
        kept = json.loads(json.dumps(state))
        whole = annealing_segment(problem, np.random.default_rng([7, index]), state, never)
        again = annealing_segment(problem, np.random.default_rng([7, index]), kept, never)
        assert json.dumps(again.state) == json.dumps(whole.state)
        state = whole.state
    assert whole.tried > 0
    for candidate in whole.candidates:
        assert problem.space.admits(candidate.parameters)
        assert candidate.penalty == pytest.approx(sum(candidate.goal_penalties))


def test_it_cools_and_lowers_the_penalty():
    # With one of three joints locked the task is out of reach: no chain ends early at zero.
    settings = DesignSettings(method='annealing', angles=9)
    problem = design_problem(TASK, DesignSpec(3, 1, -2.6, 2.6), settings)
    first, last = [], []
    for seed in range(3):
        state = None
        candidates = []
        for index in range(4):
            rng = np.random.default_rng([seed, index])
            segment = annealing_segment(problem, rng, state, never)
            state = segment.state
            candidates += segment.candidates
        first += [candidate.penalty for candidate in candidates[:10]]
        last += [candidate.penalty for candidate in candidates[-5:]]
        temperatures = [candidate.temperature for candidate in candidates]
        assert temperatures == sorted(temperatures, reverse=True)
        assert state['temperature'] < 0.05 * temperatures[0]
    assert np.mean(last) < 0.5 * np.mean(first)
