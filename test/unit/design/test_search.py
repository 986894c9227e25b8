"""The search as a whole: proved designs, checked by brute force; seeds, workers, budgets, stop."""

import numpy as np
import pytest

from ft_manip_ros.core.arm_file import load_dh
from ft_manip_ros.core.design.certificate import certify_design
from ft_manip_ros.core.design.job import DesignJob
from ft_manip_ros.core.design.proof import prove
from ft_manip_ros.core.design.search import design_arm
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.verdict import Verdict
from ft_manip_ros.core.goal import DesignSpec, Goal, Task
from ft_manip_ros.core.task_file import load_task
from support.dense_reach import worst_miss

TASK = load_task('paredis_eq_11')


def check_by_brute_force(task, result, angles=5):
    table = result.table
    lower = np.array([joint.lower for joint in table.joints])
    upper = np.array([joint.upper for joint in table.joints])
    for goal in task.goals:
        miss, where = worst_miss(
            table.d, table.a, table.alpha, lower, upper, goal.position, angles=angles, starts=60
        )
        assert miss < 1e-5, f'{goal.id} is missed by {miss} m with {where}'


@pytest.mark.parametrize('seed', range(3))
def test_the_papers_task_gets_a_proved_design(seed):
    result = design_arm(TASK, settings=DesignSettings(seed=seed))
    assert result.proved, result.reason
    assert result.penalty == 0.0
    assert [v.verdict for v in result.proof.verdicts] == [Verdict.MEMBER] * 3
    assert result.table.n == 5
    assert all(j.upper == pytest.approx(np.deg2rad(150)) for j in result.table.joints)
    check_by_brute_force(TASK, result)


def test_random_tasks_get_designs_that_brute_force_confirms():
    rng = np.random.default_rng(5)
    for seed, limit in enumerate((np.pi, 2.0)):
        goals = tuple(Goal(rng.uniform(-0.6, 0.6, 3), id=f'g{i}') for i in range(3))
        task = Task(f'random_{seed}', goals)
        spec = DesignSpec(5, 1, -limit, limit)
        result = design_arm(task, spec, DesignSettings(seed=seed))
        assert result.proved, result.reason
        check_by_brute_force(task, result)


def test_four_joints_without_limits_are_confirmed_by_two_others():
    # More than the theory of planar arms expects, so both independent checks have to agree.
    result = design_arm(TASK, DesignSpec(4, 1), DesignSettings(seed=1))
    assert result.proved, result.reason
    check_by_brute_force(TASK, result, angles=25)
    outcomes = certify_design(result.table.chain(), TASK, 1)[1]
    assert [confirmed for confirmed, _ in outcomes] == [True] * 3


def test_a_proved_design_is_made_shorter_and_proved_again():
    def length(result):
        return np.hypot(result.table.a, result.table.d).sum()

    first = design_arm(TASK, settings=DesignSettings(seed=2))
    settings = DesignSettings(seed=2, shorten=True, time_budget=first.elapsed + 12.0)
    result = design_arm(TASK, settings=settings)
    assert result.proved
    assert length(result) < 0.99 * length(first)
    assert f'{length(result):.3f}' in result.reason
    assert prove(result.table.chain(), TASK, 1).proved
    check_by_brute_force(TASK, result)


def test_table_3_passes_the_proof():
    proof = prove(load_dh('paredis_table_3').chain(), TASK, 1)
    assert proof.proved
    assert 'all 3 goals' in proof.reason


def test_the_same_seed_gives_the_same_design_whatever_the_workers():
    seen = []

    def run(workers):
        stream = []
        result = design_arm(
            TASK,
            settings=DesignSettings(seed=11, workers=workers),
            on_candidate=lambda c, b: stream.append((c.iteration, c.penalty, b.penalty)),
        )
        seen.append(stream)
        return result

    one, three = run(1), run(3)
    np.testing.assert_array_equal(one.table.d, three.table.d)
    np.testing.assert_array_equal(one.table.a, three.table.a)
    np.testing.assert_array_equal(one.table.alpha, three.table.alpha)
    assert (one.iterations, one.evaluations) == (three.iterations, three.evaluations)
    assert seen[0] == seen[1]
    bests = [best for _, _, best in seen[0]]
    assert bests == sorted(bests, reverse=True)
    assert [i for i, _, _ in seen[0]] == sorted(i for i, _, _ in seen[0])


def test_different_seeds_give_different_designs():
    a, b = (design_arm(TASK, settings=DesignSettings(seed=s)) for s in (21, 22))
    assert not np.array_equal(a.table.d, b.table.d)


def test_nothing_is_announced_without_a_proof():
    # Three joints: with one locked, two remain, and they cannot reach points in space.
    settings = DesignSettings(max_segments=6)
    result = design_arm(TASK, DesignSpec(3, 1, -2.6, 2.6), settings)
    assert not result.proved
    assert result.proof is None
    assert result.penalty > 0.0
    assert '6 segments' in result.reason
    assert result.table.n == 3


def test_the_time_budget_ends_the_search():
    result = design_arm(TASK, DesignSpec(3, 1, -2.6, 2.6), DesignSettings(time_budget=0.5))
    assert not result.proved
    assert 'time budget' in result.reason
    assert np.isfinite(result.penalty)


def test_stopping_keeps_the_best():
    job = DesignJob(TASK, DesignSpec(3, 1, -2.6, 2.6), DesignSettings())
    while job.best is None:
        assert not job.wait(0.05)
    job.stop()
    assert job.wait(20.0)
    assert job.error is None
    assert not job.result.proved
    assert 'request' in job.result.reason
    assert job.result.penalty <= min(c.penalty for c, _ in job.take_news())


def test_bounds_and_steps_hold_in_the_result():
    settings = DesignSettings(
        seed=1, alpha_step=np.pi / 4, bounds={'d': (-0.6, 0.6)}, fixed={'a_1': 0.2}
    )
    result = design_arm(TASK, settings=settings)
    assert result.proved, result.reason
    check_by_brute_force(TASK, result)
    steps = result.table.alpha / (np.pi / 4)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-12)
    assert np.abs(result.table.d).max() <= 0.6
    assert result.table.a[0] == 0.2


@pytest.mark.parametrize(
    ('options', 'field'),
    [
        ({'method': 'guess'}, 'method'),
        ({'inner': 'guess'}, 'inner'),
        ({'middle': 'guess'}, 'middle'),
        ({'seed': -1}, 'seed'),
        ({'workers': 0}, 'workers'),
        ({'time_budget': np.nan}, 'time_budget'),
        ({'time_budget': 0.0}, 'time_budget'),
        ({'margin': -0.1}, 'margin'),
        ({'limit_margin': np.nan}, 'limit_margin'),
        ({'ball': np.nan}, 'ball'),
        ({'angles': 1}, 'angles'),
    ],
)
def test_bad_settings_are_named(options, field):
    with pytest.raises(InputError, match=field):
        DesignSettings(**options)
