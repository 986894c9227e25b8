"""Replay where nodes and recorder did not hear the same, or not at the same time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ft_manip_ros.bags.reader import Bag, BagMessage
from ft_manip_ros.bags.replay import ReplayResult, replay
from ft_manip_ros.nodes.conversions import nanoseconds
from support.bag_rewrite import definitions, rewrite


def diagnostics(bag: Bag, counts: list[int]) -> list[BagMessage]:
    """The monitor's diagnostics with these counts of missed joint states, a second apart."""
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

    from support.cdr import cdr

    type_name = 'diagnostic_msgs/msg/DiagnosticArray'
    messages = []
    for k, count in enumerate(counts):
        other = DiagnosticStatus(name='replanner: replanner')
        mine = DiagnosticStatus(name='fault_monitor: fault_monitor')
        mine.values = [KeyValue(key='missed joint states', value=str(count))]
        at = bag.start + (k + 1) * 10**9
        data = cdr(DiagnosticArray(status=[other, mine]))
        messages.append(BagMessage('/diagnostics', type_name, at, at, data))
    return messages


def test_a_monitor_that_missed_samples_is_named_where_it_came_late(
    bag: Bag, tmp_path: Path
) -> None:
    from support.cdr import edited

    kinds = definitions(bag)

    def late(event: Any) -> None:
        event.stamp.sec += 1

    def change(record: BagMessage) -> BagMessage:
        if record.topic != '/fault_events':
            return record
        data = edited(record.type_name, kinds[record.type_name].text, record.data, late)
        return record._replace(data=data)

    extra = diagnostics(bag, [2, 2, 9])
    result = replay(rewrite(bag, tmp_path / 'late', change, extra))
    assert result.differences
    assert [note for note in result.notes if note.startswith('7 joint states')]
    # Without a difference there is nothing to explain.
    same = replay(rewrite(bag, tmp_path / 'same', None, extra))
    assert not same.differences
    assert not [note for note in same.notes if 'never reached' in note]


def test_a_fault_state_recorded_late_does_not_undo_a_later_one(
    bag: Bag, result: ReplayResult, tmp_path: Path
) -> None:
    """On a busy machine the last one without a lock may come behind the state of the plan."""
    *_, healthy, locked, _ = bag.messages(['/fault_state'])
    late = locked.log_time - 1_000_000

    def delay(record: BagMessage) -> BagMessage:
        is_it = record.topic == '/fault_state' and record.log_time == healthy.log_time
        return record._replace(log_time=late) if is_it else record

    again = replay(rewrite(bag, tmp_path / 'bag', delay))
    assert not again.differences
    assert again.digest == result.digest


def test_a_state_that_only_the_replanner_received_is_taken_from_its_plan(
    bag: Bag, result: ReplayResult, tmp_path: Path
) -> None:
    """The recorder joined too late for the state that the first plan starts from."""
    plans = [bag.decode(m) for m in bag.messages(['/replanner/task_plan', '/recovery_plan'])]
    starts = [nanoseconds(plan.trajectory.header.stamp) for plan in plans]
    assert len(starts) == 2
    lost = []

    def lose(record: BagMessage) -> BagMessage | None:
        if record.topic != '/joint_states':
            return record
        stamp = nanoseconds(bag.decode(record).header.stamp)
        # Until 50 ms after the start of the first, and the very state of the second.
        if stamp <= starts[0] + 50_000_000 or stamp == starts[1]:
            lost.append(stamp)
            return None
        return record

    again = replay(rewrite(bag, tmp_path / 'bag', lose))
    assert set(starts) <= set(lost)
    plans_of = [[f for f in r.replayed if f.kind == 'plan'] for r in (again, result)]
    assert plans_of[0] == plans_of[1]
    assert not again.differences


COMMANDS = '/joint_trajectory_controller/joint_trajectory'


def heard(bag: Bag, start: int, after: int) -> BagMessage:
    """What the monitor says when it takes a command, at the end of the bag."""
    from builtin_interfaces.msg import Time

    from ft_manip_interfaces.msg import CommandHeard
    from support.cdr import cdr

    def time(ns: int) -> Time:
        return Time(sec=ns // 10**9, nanosec=ns % 10**9)

    data = cdr(CommandHeard(start=time(start), after=time(after)))
    name = 'ft_manip_interfaces/msg/CommandHeard'
    return BagMessage('/fault_monitor/commands_heard', name, bag.end, bag.end, data)


@pytest.mark.parametrize('in_blocks', [True, False])
@pytest.mark.parametrize('late', [False, True])
def test_a_command_is_taken_where_the_monitor_took_it(
    bag: Bag,
    result: ReplayResult,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    late: bool,
    in_blocks: bool,
) -> None:
    """Whenever the recorder heard it: on time, or when the lock was all but found."""
    if not in_blocks:
        monkeypatch.setattr('ft_manip_ros.bags.replay._in_blocks', lambda bag, parts: set())
    command = next(bag.messages([COMMANDS]))
    start = nanoseconds(bag.decode(command).header.stamp)
    states = [
        (record.log_time, nanoseconds(bag.decode(record).header.stamp))
        for record in bag.messages(['/joint_states'])
    ]

    def stamp_before(log_time: int) -> int:
        return max(stamp for logged, stamp in states if logged < log_time)

    def at(log_time: int) -> Callable[[BagMessage], BagMessage | None]:
        def move(record: BagMessage) -> BagMessage | None:
            # The plan tells of it, too.
            if record.topic == '/replanner/task_plan' and late:
                return None
            return record._replace(log_time=log_time) if record == command else record

        return move

    fault = next(f for f in result.replayed if f.kind == 'fault')
    delayed = fault.stamp - 15_000_000
    took, recorded = (delayed, command.log_time) if late else (command.log_time, delayed)
    told = [heard(bag, start, stamp_before(took))]
    changed = replay(rewrite(bag, tmp_path / 'told', at(recorded), told))
    same = replay(rewrite(bag, tmp_path / 'same', at(took)))
    assert changed.digest == same.digest
    faults = [[f for f in r.replayed if f.kind == 'fault'] for r in (changed, result)]
    assert (faults[0] != faults[1]) == late
