"""Losses are told from the numbers of what did come."""

from __future__ import annotations

import pytest

from ft_manip_ros.nodes.loss_count import LossCount


@pytest.mark.parametrize(
    ('numbers', 'lost'),
    [
        ([5, 6, 7], 0),
        ([5, 7, 8, 12], 4),
        # Handed over in another order, or by a publisher that began anew.
        ([5, 6, 3, 4], 0),
        ([5, None, 9, 10], 0),
    ],
)
def test_gaps_are_counted_from_the_first_message_on(numbers, lost):
    count = LossCount()
    for number in numbers:
        count.note(number, 1)
    assert count.lost == lost


def test_nothing_is_counted_while_several_publish():
    count = LossCount()
    for number, publishers in ((5, 1), (9, 2), (40, 2), (6, 1), (8, 1)):
        count.note(number, publishers)
    assert count.lost == 1
