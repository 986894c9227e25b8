"""Any sequence of messages, however malformed, leaves the monitor consistent."""

from __future__ import annotations

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.detection.feed import MonitorFeed
from ft_manip_ros.core.detection.monitor import FaultMonitor
from ft_manip_ros.core.detection.states import LATCHED, JointState
from ft_manip_ros.core.errors import InputError

CHAIN = load_arm('planar_3r')
NAMES = CHAIN.joint_names
anything = st.floats(allow_nan=True, allow_infinity=True)
sane = st.floats(-1.5, 1.5)
value = st.one_of(sane, anything)
names = st.lists(st.sampled_from([*NAMES, 'x', '']), max_size=5)
values = st.lists(value, max_size=5)
step = st.one_of(
    st.just(10_000_000),
    st.integers(-(10**10), 10**10),
    st.sampled_from([0, -(10**9), 2**62]),
)
points = st.lists(st.tuples(value, values, values, values), max_size=3)
message = st.one_of(
    st.tuples(st.just('joint_state'), step, names, values, values, values),
    st.tuples(st.just('good'), st.just(10_000_000), st.lists(sane, min_size=3, max_size=3)),
    st.tuples(st.just('trajectory'), step, names, points),
    st.tuples(st.just('reference'), step, names, values),
    st.tuples(
        st.just('freeze'), step, st.sampled_from([*NAMES, 'x']), st.one_of(st.none(), value)
    ),
    st.tuples(st.just('clear'), step, st.sampled_from([*NAMES, 'x', ''])),
    st.tuples(st.just('forget'), step),
    st.tuples(
        st.just('tool'),
        step,
        st.sampled_from(['', 'base_link', 'camera']),
        st.lists(value, min_size=2, max_size=3),
    ),
)


@settings(max_examples=150, deadline=None)
@given(st.lists(message, max_size=60), st.booleans())
def test_whatever_comes_the_monitor_lives_and_its_reports_hold_together(messages, seen):
    monitor = FaultMonitor(NAMES, chain=CHAIN if seen else None)
    feed = MonitorFeed(monitor, 'base_link')
    now = 10**12
    for kind, ahead, *content in messages:
        now = max(now + ahead, 0) if abs(ahead) < 2**60 else now
        before = [report.state for report in monitor.states()]
        try:
            if kind == 'joint_state':
                feed.joint_state(now, now, *content)
            elif kind == 'good':
                feed.joint_state(now, now, NAMES, *content)
            elif kind == 'tool':
                feed.tool_pose(now, now, *content)
            elif kind == 'trajectory':
                feed.trajectory(now, now, *content)
            elif kind == 'reference':
                feed.reference(now, now, *content)
            elif kind == 'freeze':
                monitor.freeze(content[0], content[1], 'fuzz', now)
            elif kind == 'clear':
                monitor.clear(content[0], now)
            else:
                monitor.forget_time()
        except InputError as error:
            assert error.field
            assert [report.state for report in monitor.states()] == before
        for report, state in zip(monitor.states(), before, strict=True):
            if state in LATCHED and kind not in ('clear', 'freeze'):
                assert report.state in LATCHED
            assert math.isfinite(report.frozen_position) == (report.state == JointState.LOCKED)
            assert report.state != JointState.LOCKED or report.frozen_position_sigma > 0.0
            assert not math.isinf(report.position)
        assert set(monitor.frozen()) == {
            report.name for report in monitor.states() if report.state == JointState.LOCKED
        }
