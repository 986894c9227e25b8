"""What is written about parameters is what the nodes declare."""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path
from types import ModuleType

import pytest
import yaml

from ft_manip_ros.nodes.parameters import AUTOSTART

ROOT = Path(__file__).parents[2]


def load_script() -> ModuleType:
    """Import scripts/document_parameters.py."""
    path = ROOT / 'scripts' / 'document_parameters.py'
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


SCRIPT = load_script()
# With a configuration file faults survive a restart; without one nothing is written to disk.
ON_PURPOSE = {('fault_monitor', 'state_file')}


def test_the_page_of_parameters_is_up_to_date() -> None:
    assert (ROOT / 'docs' / 'parameters.md').read_text() == SCRIPT.page(), (
        'run scripts/document_parameters.py'
    )


@pytest.mark.parametrize('node', SCRIPT.MODULES)
def test_the_configuration_file_has_the_defaults(node: str) -> None:
    module = importlib.import_module(f'ft_manip_ros.nodes.{SCRIPT.MODULES[node]}')
    defaults = {spec.name: spec.default for spec in (*module.PARAMETERS, AUTOSTART)}
    text = yaml.safe_load((ROOT / 'config' / f'{node}.yaml').read_text())
    (configured,) = (section['ros__parameters'] for section in text.values())
    assert set(configured) <= set(defaults)
    differing = {
        name: (value, defaults[name])
        for name, value in configured.items()
        if value != defaults[name]
        and not (value == [] and hasattr(defaults[name], 'name'))
        and (node, name) not in ON_PURPOSE
    }
    assert not differing
