"""Replay of a bag through the same cores as the nodes, and its comparison with the recording."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from ft_manip_ros.bags import replay_faults, replay_plans, replay_verdicts
from ft_manip_ros.bags.findings import Difference, Finding, Tolerance, compare, digest
from ft_manip_ros.bags.joint_blocks import JointBlock, is_joint_state, joint_runs
from ft_manip_ros.bags.reader import Bag
from ft_manip_ros.bags.replay_faults import FaultReplay, missed_joint_states
from ft_manip_ros.bags.replay_plans import PlanReplay
from ft_manip_ros.bags.replay_setup import ReplaySetup
from ft_manip_ros.bags.replay_verdicts import VerdictReplay
from ft_manip_ros.core.errors import InputError

_NUMBERS = {**replay_faults.NUMBERS, **replay_verdicts.NUMBERS, **replay_plans.NUMBERS}
_TOLERANCE = Tolerance(numbers=_NUMBERS)
# With other parameters the question is by how much, so every difference counts.
_OVERRIDDEN = Tolerance(time=0.0, pairing=10.0, exact=True)
# What is found at the very end may have been recorded no more (ns).
_LAST = 300_000_000


@dataclass(frozen=True)
class ReplayResult:
    """Outcome of a replay.

    Attributes
    ----------
    recorded, replayed
        Findings of the bag and of the replay, by time.
    differences
        Where they disagree.
    digest
        Over the replayed findings; the same on every machine and for every thread count.
    messages, refused
        Messages replayed, and those that the cores refused as malformed, by reason.
    start
        Log time of the bag's first message (ns).
    duration, elapsed
        Recorded time span and wall time of the replay (s).
    notes
        What was missing or damaged.
    """

    recorded: tuple[Finding, ...]
    replayed: tuple[Finding, ...]
    differences: tuple[Difference, ...]
    digest: str
    messages: int
    refused: Mapping[str, int]
    start: int
    duration: float
    elapsed: float
    notes: tuple[str, ...]


def replay(
    bag: Bag,
    *,
    overrides: Mapping[str, Any] | None = None,
    arm: str = '',
    start: int | None = None,
    end: int | None = None,
    threads: int = 1,
    exact: bool = False,
) -> ReplayResult:
    """Re-run a bag's recorded inputs and compare verdicts, faults and plans with the recorded.

    Parameters
    ----------
    overrides
        Parameter values instead of the recorded ones, by ``name`` or ``node.name``.
    arm
        Arm to use instead of the recorded one.
    start, end
        Log times (ns) between which messages are replayed.
    threads
        For FTWS queries; the result does not depend on it.
    exact
        Also compare what conclusions rest on (margins, witnesses, trajectories): for a bag that
        this version has recorded.

    Raises
    ------
    InputError
        If the bag lacks what a replay needs, or an override names no parameter.
    """
    began = time.perf_counter()
    setup = ReplaySetup(bag, overrides or {}, arm)
    setup.check_overrides(
        {replay_faults.NODE: replay_faults.SETTINGS, replay_plans.NODE: replay_plans.SETTINGS}
    )
    parts = (FaultReplay(setup), VerdictReplay(setup, threads=threads), PlanReplay(setup))
    wanted = {topic for part in parts for topic in part.handlers}
    if not wanted:
        raise InputError(
            f'bag {bag.path}',
            'holds nothing to replay (no joint_states, fault_events, queries or plans); '
            f'it has {", ".join(sorted(bag.topics)) or "no topics"}',
        )
    messages = 0
    refused: dict[str, int] = {}
    for item in joint_runs(bag, wanted, _in_blocks(bag, parts), start, end):
        topic = item.topic
        if isinstance(item, JointBlock):
            messages += len(item.stamps)
            for part in parts:
                for error in part.block_handlers[topic](item) if topic in part.handlers else ():
                    _count(refused, f'{topic}: {error}')
            continue
        messages += 1
        try:
            message = bag.decode_expected(item)
        except InputError as error:
            _count(refused, f'{topic}: {error.problem}')
            continue
        for part in parts:
            handler = part.handlers.get(topic)
            if handler is None:
                continue
            try:
                handler(item, message)
            except InputError as error:
                # As in the nodes: a malformed message is refused, and the state stays.
                _count(refused, f'{topic}: {error}')
    notes = [*bag.notes, *setup.notes]
    if parts[1].unanswered:
        notes.append(f'{parts[1].unanswered} queries ran out of time when recorded: not compared')
    recorded = _ordered(
        f
        for part in parts
        for f in part.recorded
        if (start is None or f.stamp >= start) and (end is None or f.stamp <= end)
    )
    replayed = _ordered(f for part in parts for f in part.replayed)
    late = [f for f in replayed if f.stamp > bag.end - _LAST]
    tolerance = _OVERRIDDEN if overrides else dataclasses.replace(_TOLERANCE, exact=exact)
    differences = tuple(
        difference
        for difference in compare(recorded, replayed, tolerance)
        if difference.recorded is not None or difference.replayed not in late
    )
    if differences and not overrides and (missed := missed_joint_states(bag)):
        notes.append(
            f'{missed} joint states of the bag never reached the recorded fault monitor, which '
            'may have said some things later, or not at all'
        )
    return ReplayResult(
        recorded,
        replayed,
        differences,
        digest(replayed),
        messages,
        refused,
        bag.start,
        (bag.end - bag.start) * 1e-9,
        time.perf_counter() - began,
        tuple(notes),
    )


def _in_blocks(bag: Bag, parts: Iterable[FaultReplay | VerdictReplay | PlanReplay]) -> set[str]:
    """Topics of joint states that all parts take in blocks."""
    found = {topic for part in parts for topic in part.block_handlers}
    return {
        topic
        for topic in found
        if all(topic in part.block_handlers for part in parts if topic in part.handlers)
        and is_joint_state(bag, topic)
    }


def _ordered(findings: Any) -> tuple[Finding, ...]:
    return tuple(sorted(findings, key=lambda f: (f.stamp, f.kind, f.about)))


def _count(refused: dict[str, int], reason: str) -> None:
    refused[reason] = refused.get(reason, 0) + 1
