"""Task files and goals: what is read, what is refused and how it is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ft_manip_ros.core.config_files import config_folder
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import (
    DesignSpec,
    Goal,
    Task,
    quaternion_from_rotation,
    rotation_from_quaternion,
)
from ft_manip_ros.core.region import Box, Sphere
from ft_manip_ros.core.task_file import load_task

GOOD = """
name: task
goals:
  - {position: [0.5, 0, 0.5]}
  - {id: turned, position: [0, 0.5, 0.2], orientation: [0, 0, 0.6, 0.8], position_tolerance: 2e-3}
  - {position: [0, 0, 1], orientation: [1, 0, 0, 0], free_axis: true, orientation_tolerance_deg: 1,
     straight_line: true}
design:
  {dof: 5, order: 1, joint_limits_deg: [-150, 150], bounds: {a: [0, 2], alpha_deg: [-90, 90]}}
"""


def _load(folder: Path, text: str) -> Task:
    path = folder / 'task.yaml'
    path.write_text(text)
    return load_task(path)


def test_every_field_is_read(tmp_path: Path) -> None:
    task = _load(tmp_path, GOOD)
    first, second, third = task.goals
    assert (first.id, second.id, third.id) == ('goal_1', 'turned', 'goal_3')
    assert first.position.tolist() == [0.5, 0.0, 0.5]
    assert first.orientation is None
    assert second.orientation == pytest.approx(
        Rotation.from_quat([0.0, 0.0, 0.6, 0.8]).as_matrix()
    )
    assert second.position_tolerance == 2e-3
    assert third.free_axis
    assert third.straight_line
    assert not second.straight_line
    assert third.orientation_tolerance == pytest.approx(np.deg2rad(1.0))
    assert task.design is not None
    assert (task.design.dof, task.design.order) == (5, 1)
    assert task.design.upper == pytest.approx(np.deg2rad(150.0))
    assert task.design.bounds is not None
    assert task.design.bounds['a'] == (0.0, 2.0)
    assert task.design.bounds['alpha'] == pytest.approx((-np.pi / 2, np.pi / 2))


VOLUMES = """
name: volumes
regions:
  - {id: bin, box: {center: [0.5, 0.3, 0.4], size: [0.3, 0.2, 0.1]}}
  - {sphere: {center: [0, 0, 1], radius: 0.1}, orientation: [0, 0, 0.6, 0.8], free_axis: true}
design:
  dof: 3
  joint_limits_deg: [[-90, 90], [-100, 120], [0, 180]]
  bounds: {a: [0, 2], a_2: [0.1, 0.2], alpha_2_deg: [-90, 90]}
  fixed: {d_1: 0.3, alpha_1_deg: 90}
  alpha_step_deg: 15
  family: free
  max_length: 2.5
"""


def test_volumes_and_all_of_the_design_section_are_read(tmp_path: Path) -> None:
    task = _load(tmp_path, VOLUMES)
    box, sphere = task.goals
    assert (box.id, box.region) == ('bin', Box((0.3, 0.2, 0.1)))
    assert box.position.tolist() == [0.5, 0.3, 0.4]
    assert (sphere.id, sphere.region) == ('region_2', Sphere(0.1))
    assert sphere.free_axis
    spec = task.design
    assert spec is not None
    assert np.rad2deg(spec.joint_limits) == pytest.approx(
        np.array([[-90.0, 90.0], [-100.0, 120.0], [0.0, 180.0]])
    )
    assert spec.bounds['a_2'] == (0.1, 0.2)
    assert spec.bounds['alpha_2'] == pytest.approx((-np.pi / 2, np.pi / 2))
    assert spec.fixed == {'d_1': 0.3, 'alpha_1': pytest.approx(np.pi / 2)}
    assert spec.alpha_step == pytest.approx(np.pi / 12)
    assert (spec.family, spec.max_length) == ('free', 2.5)


def test_the_papers_task_is_equation_11() -> None:
    task = load_task('paredis_eq_11')
    assert [goal.position.tolist() for goal in task.goals] == [
        [0.5, 0.0, 0.5],
        [0.0, 0.5, 0.25],
        [0.75, 0.0, 0.5],
    ]


@pytest.mark.parametrize(
    'path', sorted(config_folder('tasks').glob('*.yaml')), ids=lambda p: p.stem
)
def test_every_task_of_the_package_loads_by_its_name(path: Path) -> None:
    assert load_task(path.stem).name == path.stem


REFUSED = {
    'two numbers': ('[0.5, 0, 0.5]', '[0.5, 0]', r'goals\[0\]\.position: is a list of 2'),
    'nan': ('[0.5, 0, 0.5]', '[0.5, .nan, 0.5]', r'goals\[0\]\.position\[1\]: is nan'),
    'text': ('[0.5, 0, 0.5]', '[0.5, x, 0.5]', r"goals\[0\]\.position\[1\]: is 'x'"),
    'not a unit': ('0.6, 0.8', '0.6, 0.9', r'goals\[1\]\.orientation: has norm'),
    'free of nothing': (', orientation: [1, 0, 0, 0]', '', r'goals\[2\].*free_axis: needs'),
    'not a flag': ('free_axis: true', 'free_axis: yes', r"goals\[2\]\.free_axis: is 'yes'"),
    'no tolerance': ('2e-3', '0', r'goals\[1\].*position_tolerance: is 0.0; must be'),
    'unknown key': ('free_axis', 'free_axes', r'goals\[2\]\.free_axes: is not a known key'),
    'same id twice': ('{position: [0.5', '{id: turned, position: [0.5', r"'turned'\] appear more"),
    'part of a joint': ('dof: 5', 'dof: 5.5', r'design\.dof: is 5\.5; a whole number'),
    'too few joints': ('dof: 5', 'dof: 1', r'design.*dof: is 1; must exceed'),
    'limits swapped': ('[-150, 150]', '[150, -150]', r'design.*joint limits'),
    'unknown bound': ('bounds: {a:', 'bounds: {theta:', r'design\.bounds\.theta: is not a known'),
}


REFUSED_VOLUMES = {
    'no volume': ('box: {center: [0.5, 0.3, 0.4], size: [0.3, 0.2, 0.1]}', '', r'regions\[0\]'),
    'flat': ('size: [0.3, 0.2, 0.1]', 'size: [0.3, 0, 0.1]', r'regions\[0\]\.box.*size'),
    'hollow': ('radius: 0.1', 'radius: -1', r'regions\[1\]\.sphere.*radius'),
    'no centre': ('center: [0, 0, 1], ', '', r'regions\[1\]\.sphere\.center: is missing'),
    'two volumes': ('- {sphere', '- {box: {}, sphere', r'regions\[1\].*one of'),
    'one limit less': (', [0, 180]]', ']', r'design.*limits: lower: has 2'),
    'half a limit': ('[0, 180]]', '[0]]', r'joint_limits_deg\[2\]: is a list of 1'),
    'limits mixed': ('[0, 180]]', '0]', r'joint_limits_deg\[2\]: is 0'),
    'unknown joint': ('d_1:', 'd_9:', r'design\.fixed\.d_9: is not a known key'),
    'unknown family': ('family: free', 'family: round', r'design.*family.*symmetric'),
    'no step': ('alpha_step_deg: 15', 'alpha_step_deg: -15', r'design.*alpha_step'),
    'no length': ('max_length: 2.5', 'max_length: 0', r'design.*max_length'),
}


@pytest.mark.parametrize('case', REFUSED_VOLUMES)
def test_what_is_wrong_in_volumes_is_named(case: str, tmp_path: Path) -> None:
    old, new, message = REFUSED_VOLUMES[case]
    assert old in VOLUMES
    with pytest.raises(InputError, match=message):
        _load(tmp_path, VOLUMES.replace(old, new, 1))


@pytest.mark.parametrize('case', REFUSED)
def test_what_is_wrong_is_named(case: str, tmp_path: Path) -> None:
    old, new, message = REFUSED[case]
    assert old in GOOD
    with pytest.raises(InputError, match=message) as raised:
        _load(tmp_path, GOOD.replace(old, new, 1))
    assert 'task.yaml' in str(raised.value)


def test_a_task_without_goals_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match='goals: is missing'):
        _load(tmp_path, 'name: nothing')


def test_quaternions_and_matrices_agree_with_scipy() -> None:
    for rotation in Rotation.random(200, random_state=1):
        matrix = rotation.as_matrix()
        assert rotation_from_quaternion(rotation.as_quat(), 'q') == pytest.approx(matrix)
        again = quaternion_from_rotation(matrix)
        assert again[3] >= 0.0
        assert rotation_from_quaternion(again, 'q') == pytest.approx(matrix)


@pytest.mark.parametrize('axis', [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0.6, 0.8]])
def test_half_turns_have_a_quaternion(axis: list[float]) -> None:
    matrix = Rotation.from_rotvec(np.pi * np.array(axis)).as_matrix()
    assert rotation_from_quaternion(quaternion_from_rotation(matrix), 'q') == pytest.approx(matrix)


@pytest.mark.parametrize(
    'fields',
    [
        {'position': [0.0, 0.0]},
        {'position': [0.0, 0.0, np.nan]},
        {'position': np.zeros(3), 'orientation': np.diag([1.0, 1.0, -1.0])},
        {'position': np.zeros(3), 'orientation': 2.0 * np.eye(3)},
        {'position': np.zeros(3), 'orientation': np.full((3, 3), np.nan)},
        {'position': np.zeros(3), 'position_tolerance': -1.0},
    ],
)
def test_goals_refuse_what_is_no_goal(fields: dict[str, object]) -> None:
    with pytest.raises(InputError, match='goal'):
        Goal(**fields)  # type: ignore[arg-type]


@pytest.mark.parametrize('fields', [{'dof': 2, 'order': 2}, {'dof': 3, 'order': 0}, {'dof': 99}])
def test_design_specs_refuse_what_cannot_be(fields: dict[str, int]) -> None:
    with pytest.raises(InputError, match='design'):
        DesignSpec(**fields)
