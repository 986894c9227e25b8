"""Compiled code is dropped when something that was built into it has changed."""

from __future__ import annotations

import importlib.util
import os
import time
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / 'scripts' / 'stale_kernels.py'


@pytest.mark.skipif(not SCRIPT.exists(), reason='installed without the scripts folder')
def test_only_what_depends_on_a_change_is_dropped(tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location('stale_kernels', SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    package = tmp_path / 'ft_manip_ros'
    cache = package / '__pycache__'
    cache.mkdir(parents=True)
    sources = {
        'changed': '',
        'calls_it': 'from ft_manip_ros.changed import f\n',
        'calls_that': 'from ft_manip_ros.calls_it import g\n',
        'apart': 'import numpy\n',
    }
    compiled = time.time() - 100.0
    for name, text in sources.items():
        (package / f'{name}.py').write_text(text)
        for kind in ('nbi', '1.nbc'):
            (cache / f'{name}.f-3.py311.{kind}').write_text('')
            os.utime(cache / f'{name}.f-3.py311.{kind}', (compiled, compiled))
        if name != 'changed':
            os.utime(package / f'{name}.py', (compiled - 50.0, compiled - 50.0))
    script.ROOT, script.PACKAGE = tmp_path, package
    assert script.remove_stale() == 3
    assert {path.name.split('.')[0] for path in cache.iterdir()} == {'apart'}
    assert script.remove_stale() == 0
