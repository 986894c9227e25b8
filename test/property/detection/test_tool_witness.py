"""Whatever tracker sees the tool: a lock stays a lock, and a stuck encoder wrongs nobody."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from ft_manip_ros.core.detection.states import JointState
from support.seen_tool import SeenArm

offsets = st.tuples(*[st.floats(-0.2, 0.2)] * 3)


@settings(max_examples=6, deadline=None, derandomize=True)
@given(
    arm=st.sampled_from(['paredis_table_1', 'paredis_table_3']),
    divisor=st.integers(1, 6),
    noise=st.floats(0.0, 5e-3),
    delay=st.floats(0.0, 0.15),
    late=st.floats(0.0, 0.1),
    offset=offsets,
    lag=st.floats(0.0, 0.1),
    seed=st.integers(0, 10**6),
    kind=st.sampled_from(['lock', 'lock', 'stick']),
)
def test_whatever_tracker_sees_it(arm, divisor, noise, delay, late, offset, lag, seed, kind):
    seen = SeenArm(
        arm,
        tool_rate=100.0 / divisor,
        noise=noise,
        delay=delay,
        late=late,
        offset=offset,
        lag=lag,
        seed=seed,
    )
    joint = seed % seen.chain.n
    seen.run(5.0)
    assert not seen.found(seen.edges, joint)
    getattr(seen, kind)(joint)
    edges = seen.run(4.0)
    (fault,) = seen.found(edges, joint)
    if kind == 'lock':
        assert fault[1] == JointState.LOCKED
    else:
        assert fault[1] in (JointState.SENSOR, JointState.LOCKED)
    for other in range(seen.chain.n):
        assert other == joint or not seen.found(edges, other)
