"""The parameter files in config/ say what the nodes take by themselves, and nothing else."""

from __future__ import annotations

import importlib
import math
from pathlib import Path

import pytest
import yaml
from rclpy.parameter import Parameter

from ft_manip_ros.nodes.parameters import AUTOSTART

CONFIG = Path(__file__).parents[2] / 'config'
NODES = {
    'arm_sim': 'arm_sim',
    'workspace': 'workspace',
    'replanner': 'replanner',
    'recorder': 'recorder',
    'designer': 'design_parameters',
    'fault_monitor': 'fault_parameters',
}
# A launched monitor remembers faults over a restart; one started by hand begins afresh.
DIFFERENT = {('fault_monitor', 'state_file')}


def specs(node):
    module = importlib.import_module(f'ft_manip_ros.nodes.{NODES[node]}')
    return {spec.name: spec for spec in (*module.PARAMETERS, AUTOSTART)}


def in_file(node):
    content = yaml.safe_load((CONFIG / f'{node}.yaml').read_text())
    (name,) = content
    assert name.split('/')[-1] == node, 'the file is for another node'
    return content[name]['ros__parameters']


@pytest.mark.parametrize('node', NODES)
def test_files_and_defaults_agree(node):
    declared, given = specs(node), in_file(node)
    assert set(given) <= set(declared), 'parameters that the node does not have'
    for name, spec in declared.items():
        if isinstance(spec.default, Parameter.Type):
            assert not given.get(name), f'{name} is empty by default'
            continue
        assert name in given, f'{name} is missing in the file'
        # rclpy fixes the type by the default: 1 is not accepted where 1.0 is meant.
        assert type(given[name]) is type(spec.default), name
        assert given[name] == spec.default or (node, name) in DIFFERENT, name


@pytest.mark.parametrize('node', NODES)
def test_every_parameter_is_described_and_its_default_is_allowed(node):
    for spec in specs(node).values():
        assert spec.description.strip().endswith(('.', ';', ']')), spec.name
        assert (spec.lower is None) == (spec.upper is None), spec.name
        if spec.lower is not None:
            assert spec.lower <= spec.default <= spec.upper, spec.name
        if isinstance(spec.default, float):
            assert math.isfinite(spec.default)
        if spec.choices:
            assert spec.default in spec.choices, spec.name
        # Any number with a range has a unit or is a count, a share or a factor.
        descriptor = spec.descriptor()
        assert descriptor.description == spec.description
        ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
        assert len(ranges) == (spec.lower is not None), spec.name
