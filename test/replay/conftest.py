"""The recorded case that most replay tests start from."""

from __future__ import annotations

from pathlib import Path

import pytest

from ft_manip_ros.bags.reader import Bag, open_bag
from ft_manip_ros.bags.replay import ReplayResult, replay

_CASE = Path(__file__).resolve().parents[2] / 'bags' / 'locked_joint'


@pytest.fixture(scope='module')
def bag() -> Bag:
    return open_bag(_CASE / 'bag')


@pytest.fixture(scope='module')
def result(bag: Bag) -> ReplayResult:
    return replay(bag)
