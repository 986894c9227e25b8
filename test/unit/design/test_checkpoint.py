"""A search taken up from its checkpoint ends as the unbroken one."""

import json

import pytest

from ft_manip_ros.core.design.search import design_arm
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import DesignSpec
from ft_manip_ros.core.task_file import load_task

TASK = load_task('paredis_eq_11')
HOPELESS = DesignSpec(3, 1, -2.6, 2.6)


def run(path=None, *, resume=False, spec=HOPELESS, stream=None, **settings):
    result = design_arm(
        TASK,
        spec,
        DesignSettings(angles=9, **settings),
        checkpoint=path,
        resume=resume,
        on_candidate=None if stream is None else lambda c, b: stream.append(c.iteration),
    )
    return (
        result.penalty, result.iterations, result.evaluations, result.proved,
        *result.table.d, *result.table.a, *result.table.alpha,
    )  # fmt: skip


@pytest.mark.parametrize('method', ['worst_cases', 'annealing'])
@pytest.mark.parametrize('broken_after', [1, 5])
def test_it_ends_as_the_unbroken_search(method, broken_after, tmp_path):
    path = tmp_path / 'search.checkpoint'
    whole, first, second = [], [], []
    expected = run(method=method, max_segments=9, stream=whole)
    run(path, method=method, max_segments=broken_after, stream=first)
    found = run(path, resume=True, method=method, max_segments=9, workers=2, stream=second)
    assert found == expected
    # Nothing is done twice, nothing is left out.
    assert first + second == whole


def test_a_segment_cut_short_is_done_anew(tmp_path):
    path = tmp_path / 'search.checkpoint'
    expected = run(max_segments=8)
    calls = []

    def stop():
        calls.append(None)
        return len(calls) > 40

    design_arm(TASK, HOPELESS, DesignSettings(angles=9), checkpoint=path, should_stop=stop)
    assert run(path, resume=True, max_segments=8) == expected


def test_a_proved_search_leaves_no_checkpoint(tmp_path):
    path = tmp_path / 'search.checkpoint'
    assert run(path, spec=TASK.design)[3]
    assert not path.exists()
    assert list(tmp_path.iterdir()) == []


def test_a_checkpoint_of_another_search_is_refused(tmp_path):
    path = tmp_path / 'search.checkpoint'
    run(path, max_segments=1)
    for changed in (
        {'seed': 1},
        {'method': 'annealing'},
        {'margin': 0.01},
        {'spec': DesignSpec(3, 1, -2.0, 2.6)},
        {'bounds': {'a': (0.0, 0.5)}},
    ):
        with pytest.raises(InputError, match='another search'):
            run(path, resume=True, max_segments=2, **changed)


@pytest.mark.parametrize(
    'text', ['', '{}', '[]', '{"version": 1}', 'null', '\x00\x01', '{"version": 99}']
)
def test_a_damaged_checkpoint_is_named(text, tmp_path):
    path = tmp_path / 'search.checkpoint'
    path.write_text(text)
    with pytest.raises(InputError, match=r'search\.checkpoint'):
        run(path, resume=True)


def test_every_missing_field_is_noticed(tmp_path):
    path = tmp_path / 'search.checkpoint'
    run(path, max_segments=1)
    document = json.loads(path.read_text())
    for key in document:
        if key == 'task':
            continue
        path.write_text(json.dumps({k: v for k, v in document.items() if k != key}))
        with pytest.raises(InputError):
            run(path, resume=True, max_segments=2)


def test_a_missing_checkpoint_is_named(tmp_path):
    with pytest.raises(InputError, match='nothing_here'):
        run(tmp_path / 'nothing_here', resume=True)


def test_a_checkpoint_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(InputError, match='no_folder'):
        run(tmp_path / 'no_folder' / 'x', max_segments=1)
