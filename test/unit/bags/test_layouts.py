"""The Foxglove layout and the RViz configuration name what the recorder records by default."""

from __future__ import annotations

import json
import re
from pathlib import Path

import yaml

from ft_manip_ros.nodes.recorder_parameters import PARAMETERS, TOPICS

CONFIG = Path(__file__).resolve().parents[3] / 'config'
RECORDED = {'/' + topic.lstrip('/') for topic in TOPICS}


def test_foxglove_layout_shows_recorded_topics_only() -> None:
    layout = json.loads((CONFIG / 'foxglove_layout.json').read_text())
    panels = layout['configById']
    named = {'/' + match for match in re.findall(r'"/([a-z_]+(?:/[a-z_]+)?)', json.dumps(panels))}
    assert {'/joint_states', '/fault_events', '/recovery_plan', '/replanner/path'} <= named
    assert named <= RECORDED

    def shown(node: object) -> list[str]:
        if isinstance(node, str):
            return [node]
        assert isinstance(node, dict)
        return shown(node['first']) + shown(node['second'])

    assert sorted(shown(layout['layout'])) == sorted(panels)


def test_rviz_shows_recorded_topics_only() -> None:
    config = yaml.safe_load((CONFIG / 'ft_manip.rviz').read_text())
    displays = config['Visualization Manager']['Displays']
    named = {d[k]['Value'] for d in displays for k in ('Topic', 'Description Topic') if k in d}
    assert len(named) >= 5
    assert named <= RECORDED


def test_the_default_configuration_is_that_of_the_node() -> None:
    content = yaml.safe_load((CONFIG / 'recorder.yaml').read_text())
    values = content['/**/recorder']['ros__parameters']
    defaults = {spec.name: spec.default for spec in PARAMETERS}
    assert set(values) - {'autostart'} == set(defaults) - {'seed'}
    for name, value in values.items():
        if name != 'autostart':
            assert value == defaults[name], name
