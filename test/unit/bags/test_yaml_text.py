"""YAML of bags: what PyYAML's own loader makes of it, and no crash however deep it goes."""

from __future__ import annotations

import pytest
import yaml

from ft_manip_ros.bags.qos import load_profiles
from ft_manip_ros.bags.yaml_text import load_yaml


@pytest.mark.parametrize(
    'text',
    [
        '',
        '0.5',
        'on',
        "'0.5'",
        '[a, 1e-3, .nan]',
        '- history: keep_last\n  depth: 5\n',
        'a: {b: [1, 2]}\nc: "x: y"',
        '2020-01-02',
        '[' + '{a: 1}, ' * 600 + ']',
        'x' * 600,
    ],
)
def test_it_is_what_the_plain_loader_makes_of_it(text: str) -> None:
    assert repr(load_yaml(text)) == repr(yaml.safe_load(text))


@pytest.mark.parametrize(
    'text',
    [
        '[' * 100_000,
        '[\n' * 100_000,
        '{a: ' * 100_000,
        '- ' * 100_000,
        ''.join(' ' * k + '-\n' for k in range(3000)),
        '\0',
        'a: [',
        '!!python/object:os.system x',
    ],
)
def test_what_is_none_is_refused(text: str) -> None:
    with pytest.raises(yaml.YAMLError):
        load_yaml(text)
    assert load_profiles(text) == ()
