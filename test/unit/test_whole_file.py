"""Files are written whole, or what was there stays."""

from pathlib import Path

import matplotlib
import pytest

matplotlib.use('Agg')

from matplotlib import pyplot as plt

from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.whole_file import write_figure, write_whole


def test_a_file_is_replaced_and_nothing_else_is_left(tmp_path):
    file = tmp_path / 'arm.yaml'
    write_whole(file, 'first')
    write_whole(file, 'zweite Länge µ')
    assert file.read_text(encoding='utf-8') == 'zweite Länge µ'
    assert list(tmp_path.iterdir()) == [file]


def test_a_write_that_fails_leaves_the_old_file(tmp_path, monkeypatch):
    file = tmp_path / 'arm.yaml'
    write_whole(file, 'first')

    def full(self, text, **kwargs):
        self.open('w').write(text[:3])
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(Path, 'write_text', full)
    with pytest.raises(InputError, match=r'arm\.yaml: cannot be written: No space left'):
        write_whole(file, 'second')
    assert file.read_text() == 'first'
    assert list(tmp_path.iterdir()) == [file]


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(InputError, match='missing/arm'):
        write_whole(tmp_path / 'missing' / 'arm.yaml', 'text')


@pytest.mark.parametrize(
    ('name', 'begins'), [('arm.png', b'\x89PNG'), ('arm.pdf', b'%PDF'), ('arm.svg', b'<?xml')]
)
def test_a_picture_has_the_format_of_its_suffix(tmp_path, name, begins):
    write_figure(tmp_path / name, plt.figure(), 50)
    assert (tmp_path / name).read_bytes().startswith(begins)
    assert not plt.get_fignums()


@pytest.mark.parametrize(
    ('name', 'problem'), [('arm.docx', 'docx'), ('missing/arm.png', 'No such file')]
)
def test_a_picture_that_cannot_be_written_is_named(tmp_path, name, problem):
    with pytest.raises(InputError, match=rf'{name}: cannot be written: .*{problem}'):
        write_figure(tmp_path / name, plt.figure(), 50)
    assert not list(tmp_path.iterdir())
    assert not plt.get_fignums()
