"""Mimic joints: told apart from the arm's own, and checked against their leaders."""

from __future__ import annotations

import math

import pytest

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.detection.mimics import Mimic, MimicWatch, mimics_of
from ft_manip_ros.core.detection.settings import MonitorSettings
from ft_manip_ros.core.errors import InputError

URDF = """<?xml version="1.0" encoding="utf-8"?>
<robot name="gripper">
  <link name="base"/><link name="palm"/><link name="left"/><link name="right"/>
  <joint name="wrist" type="revolute"><parent link="base"/><child link="palm"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="finger" type="prismatic"><parent link="palm"/><child link="left"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.1" velocity="1" effort="1"/></joint>
  <joint name="other_finger" type="prismatic"><parent link="palm"/><child link="right"/>
    <axis xyz="1 0 0"/><limit lower="-0.1" upper="0" velocity="1" effort="1"/>
    <mimic joint="finger" multiplier="{multiplier}" offset="0.01"/></joint>
</robot>
"""
MIMIC = Mimic('other_finger', 'finger', -1.0, 0.01, True)


def feed(watch, positions, seconds=0.5, period=0.01, start=0):
    for k in range(round(seconds / period)):
        watch.sample(round((start + k * period) * 1e9), positions)
    return watch.reports()[0]


def test_mimics_of_a_urdf_are_those_of_watched_leaders():
    text = URDF.format(multiplier=-1)
    assert load_arm(text, tip='left').joint_names == ('wrist', 'finger')
    assert mimics_of(text, ['wrist', 'finger']) == [MIMIC]
    assert mimics_of(text, ['wrist']) == []
    assert mimics_of('paredis_table_3', ['joint_1']) == []


def test_a_multiplier_that_is_no_number_is_named():
    with pytest.raises(InputError, match=r"other_finger.*'half'"):
        mimics_of(URDF.format(multiplier='half'), ['finger'])
    with pytest.raises(InputError, match=r'other_finger.*multiplier.*inf'):
        mimics_of(URDF.format(multiplier='inf'), ['finger'])


def test_a_mimic_of_a_mimic_follows_the_leader_of_both():
    more = """<link name="tip"/><joint name="third" type="prismatic"><parent link="right"/>
    <child link="tip"/><axis xyz="1 0 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/>
    <mimic joint="other_finger" multiplier="2" offset="0.5"/></joint></robot>"""
    text = URDF.format(multiplier=-1).replace('</robot>', more)
    assert mimics_of(text, ['finger'])[1] == Mimic('third', 'finger', -2.0, 0.52, True)


def test_joints_of_the_chain_that_mimic_are_those_of_the_chain():
    text = URDF.format(multiplier=-1)
    chain = load_arm(text, tip='right')
    (mimic,) = mimics_of(text, chain.joint_names)
    (axis,) = [axis for axis in chain.driven if axis.name == mimic.name]
    assert (chain.joint_names[axis.joint], axis.ratio, axis.offset, axis.prismatic) == (
        mimic.leader,
        mimic.multiplier,
        mimic.offset,
        mimic.prismatic,
    )


def test_one_that_does_what_its_leader_does_agrees():
    watch = MimicWatch([MIMIC], MonitorSettings())
    assert 'not read yet' in watch.reports()[0].text
    for k in range(100):
        watch.sample(k * 10_000_000, {'finger': 0.001 * k, 'other_finger': 0.01 - 0.001 * k})
    (report,) = watch.reports()
    assert report.agrees
    assert report.expected == pytest.approx(0.01 - 0.099)
    assert 'agrees' in report.text


def test_one_that_stays_behind_is_said_to_once_it_lasts_and_until_it_agrees_again():
    watch = MimicWatch([MIMIC], MonitorSettings())
    assert feed(watch, {'finger': 0.05, 'other_finger': 0.0}, 0.09).agrees
    report = feed(watch, {'finger': 0.05, 'other_finger': 0.0}, 0.5)
    assert not report.agrees
    assert '0.04 away' in report.text
    assert feed(watch, {'finger': 0.05, 'other_finger': -0.04}, 0.02, start=1.0).agrees


def test_play_single_outliers_and_readings_that_are_not_together_are_no_news():
    watch = MimicWatch([MIMIC], MonitorSettings())
    assert feed(watch, {'finger': 0.05, 'other_finger': -0.035}).agrees
    for k in range(100):
        off = 0.09 if k % 10 == 0 else -0.04
        watch.sample(10**10 + k * 10_000_000, {'finger': 0.05, 'other_finger': off})
    assert watch.reports()[0].agrees
    for k in range(100):
        watch.sample(2 * 10**10 + k * 10_000_000, {'finger': 0.09})
    watch.sample(3 * 10**10, {'other_finger': math.nan, 'finger': math.inf})
    assert watch.reports()[0].agrees


def test_subsets_over_several_messages_are_compared():
    watch = MimicWatch([MIMIC], MonitorSettings())
    for k in range(50):
        watch.sample(k * 10_000_000, {'finger': 0.05})
        watch.sample(k * 10_000_000 + 3_000_000, {'other_finger': 0.03})
    assert not watch.reports()[0].agrees
