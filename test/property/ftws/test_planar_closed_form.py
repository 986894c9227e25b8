"""Planar arms without limits: verdicts against the exact FTWS, proofs against the verifier."""

from functools import cache

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ft_manip_ros.core.dh import DhTable
from ft_manip_ros.core.ftws.certificate import certify, verify
from ft_manip_ros.core.ftws.planar import planar_ftws, reduce_pose
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.joint import Joint

# Sixteenths of a metre are exact: where nothing touches by rounding, nothing is a close call.
SIXTEENTHS = st.integers(0, 16).map(lambda number: number / 16.0)
ANGLES = st.floats(-np.pi, np.pi)


def planar(lengths):
    n = len(lengths)
    joints = tuple(Joint(f'joint_{i + 1}') for i in range(n))
    zero = np.zeros(n)
    return DhTable('planar', joints, zero, np.array(lengths), zero, zero).chain()


@st.composite
def arms(draw):
    lengths = draw(st.lists(SIXTEENTHS, min_size=3, max_size=9))
    return lengths, draw(st.integers(2, min(4, len(lengths) - 1)))


@settings(max_examples=150, deadline=None, derandomize=True)
@given(arms(), st.integers(0, 160), ANGLES)
def test_verdicts_are_those_of_the_exact_ftws_and_are_confirmed(arm, thirty_seconds, angle):
    lengths, order = arm
    radius = thirty_seconds / 32.0
    point = radius * np.array([[np.cos(angle), np.sin(angle), 0.0]])
    (answer,), document = certify(planar(lengths), point, order=order)
    inside = any(a - 1e-9 <= radius <= b + 1e-9 for a, b in planar_ftws(lengths, order))
    assert answer.verdict.value == ('member' if inside else 'non_member')
    ((confirmed, text),) = verify(document)
    assert confirmed, text


@cache
def holds_pose(links, order, away):
    """Whether links before the tool's hold a pose (section 3.4), all lengths in 1/32 m.

    Either the joint of the tool turns freely, or it is one of those that fail: then the links
    have to hold their end in every direction with one failure less.
    """
    if order == 0:
        return max(2 * max(links, default=0) - sum(links), 0) <= away <= sum(links)
    if order == len(links):
        return sum(links) == away == 0
    exact = planar_ftws([link / 32.0 for link in links], order)
    if not any(a - 1e-9 <= away / 32.0 <= b + 1e-9 for a, b in exact):
        return False
    *rest, last = links
    # Where a ROD's reach ends is a multiple of 1/16: what is between is all alike.
    return all(
        holds_pose(tuple(rest), order - 1, other)
        for other in range(abs(away - last), away + last + 1)
    )


@settings(max_examples=150, deadline=None, derandomize=True)
@given(arms(), SIXTEENTHS, st.integers(0, 100), ANGLES, ANGLES)
def test_poses_are_those_of_section_3_4_and_are_confirmed(arm, last, away, angle, turn):
    lengths, order = arm
    assume(sum(lengths) > 0.0)
    wrist = away / 32.0 * np.array([np.cos(angle), np.sin(angle)])
    x, y = wrist + last * np.array([np.cos(turn), np.sin(turn)])
    assert reduce_pose([*lengths, last], (x, y, turn))[1] == pytest.approx(wrist, abs=1e-12)
    pose = np.array([[x, y, 0.0, 0.0, 0.0, np.sin(turn / 2), np.cos(turn / 2)]])
    (answer,), document = certify(planar([*lengths, last]), pose, order=order, mode='pose')
    held = holds_pose(tuple(round(32 * length) for length in lengths), order, away)
    assert answer.verdict.value == ('member' if held else 'non_member')
    ((confirmed, text),) = verify(document)
    assert confirmed, text


@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    st.lists(st.floats(0.0, 1.0), min_size=5, max_size=8),
    st.sampled_from([0.0, 1e-7, -1e-7, 9.999e-7, 1e-6, 1.0001e-6, 2e-6, -2e-6]),
    st.sampled_from([0.0, 1e-3]),
    st.integers(0, 100),
)
def test_the_verifier_confirms_what_is_said_on_the_boundary(lengths, beyond, radius, which):
    edges = [edge for interval in planar_ftws(lengths, 2) for edge in interval] or [0.5]
    point = np.array([[edges[which % len(edges)] + beyond, 0.0, 0.0]])
    options = FtwsSettings(radius=radius)
    _, document = certify(planar(lengths), point, order=2, settings=options)
    ((confirmed, text),) = verify(document)
    assert confirmed, text
