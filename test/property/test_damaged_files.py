"""Files damaged at random are read, or refused by an `InputError`: nothing else ever escapes."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.config_files import config_folder
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.task_file import load_task
from ft_manip_ros.core.urdf_writer import chain_to_urdf

ARM = (config_folder('arms') / 'paredis_table_3.yaml').read_text()
TASK = """
name: task
goals:
  - {id: a, position: [0.5, 0, 0.5], orientation: [0, 0, 0.6, 0.8], position_tolerance: 2e-3}
  - {position: [0, 0, 1], orientation: [1, 0, 0, 0], free_axis: true}
design: {dof: 5, order: 1, joint_limits_deg: [-150, 150], bounds: {a: [0, 2]}}
"""
URDF = chain_to_urdf(load_arm('planar_3r'))

PIECES = st.sampled_from(
    ['.nan', '-.inf', '1e999', '-1', '0', 'null', 'true', '[', ']', '{', '}', ':', ', ', '\n',
     '\t', '- ', '"', "'", '&a', '*a', '!!python/object:os.system', '<<: *a', '\x00', 'ü',
     '9' * 400, '<', '>', '/', '<joint/>', 'nan', '=', '#', '|', '%', '@']
)  # fmt: skip
EDITS = st.lists(
    st.tuples(st.floats(0.0, 1.0), st.integers(0, 30), st.one_of(PIECES, st.text(max_size=6))),
    min_size=1,
    max_size=4,
)


def _damage(text: str, edits: list[tuple[float, int, str]]) -> str:
    """Replace some characters at some places by something else."""
    for place, length, piece in edits:
        at = int(place * len(text))
        text = text[:at] + piece + text[at + length :]
    return text


def _on_disk(text: str, suffix: str) -> Path:
    path = Path(tempfile.mkdtemp(prefix='damaged_')) / f'file{suffix}'
    path.write_bytes(text.encode('utf-8', errors='surrogatepass'))
    return path


def _remove(path: Path) -> None:
    path.unlink()
    path.parent.rmdir()


@settings(max_examples=300, deadline=None, derandomize=True)
@given(EDITS)
def test_damaged_arm_files(edits: list[tuple[float, int, str]]) -> None:
    path = _on_disk(_damage(ARM, edits), '.yaml')
    try:
        chain = load_arm(path)
        assert np.isfinite(chain.translations).all()
    except InputError as error:
        assert error.field
        assert error.problem
    finally:
        _remove(path)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(EDITS)
def test_damaged_task_files(edits: list[tuple[float, int, str]]) -> None:
    path = _on_disk(_damage(TASK, edits), '.yaml')
    try:
        assert load_task(path).goals
    except InputError as error:
        assert error.field
        assert error.problem
    finally:
        _remove(path)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(EDITS)
def test_damaged_urdfs(edits: list[tuple[float, int, str]]) -> None:
    path = _on_disk(_damage(URDF, edits), '.urdf')
    try:
        chain = load_arm(path, tip='tool')
        assert np.isfinite(chain.translations).all()
        assert np.isfinite(chain.rotations).all()
    except InputError as error:
        assert error.field
        assert error.problem
    finally:
        _remove(path)
