"""The library of cases: what each is recorded with, and what it shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Case:
    """One case.

    Attributes
    ----------
    name, shows
        Folder name, and the one line of its README.
    arm, base, tip, task
        As the nodes' parameters.
    locks
        (joint, time in s from the start of the motion) of the failures.
    slow
        Joint that becomes sluggish, when, and how late (s) it is in the end.
    stuck
        Joint whose encoder sticks, and when.
    corrupt
        (kind, joint, time) of a fault that the simulated arm has no service for: the driver
        between arm and topic makes it (`story.Driver`).
    manual
        Joint that an operator declares frozen and later clears.
    sim, monitor
        Parameters of `arm_sim` and `fault_monitor`.
    query
        Points (m) that the workspace node is asked about beside the task's.
    truncate
        Name of a case whose bag is cut off instead of recording anything.
    """

    name: str
    shows: str
    arm: str = 'paredis_table_3'
    base: str = ''
    tip: str = ''
    task: str = 'paredis_eq_11'
    locks: tuple[tuple[str, float], ...] = ()
    slow: tuple[str, float, float] | None = None
    stuck: tuple[str, float] | None = None
    corrupt: tuple[str, str, float] | None = None
    manual: str = ''
    sim: Mapping[str, Any] = field(default_factory=dict)
    monitor: Mapping[str, Any] = field(default_factory=dict)
    query: tuple[tuple[float, float, float], ...] = ()
    truncate: str | None = None
    seed: int = 1


_ALL = (
    Case(
        'locked_joint',
        'joint_3 locks while the arm executes the task of equation 11; every point is still '
        'reached. Also the FTWS verdicts on the points and on one outside.',
        locks=(('joint_3', 1.6),),
        query=((1.9, 0.0, 0.0),),
    ),
    Case('no_fault', 'The same task without any failure: nothing may be reported.', seed=2),
    Case(
        'lossy_transport',
        '2 % of the joint states dropped and 2 % out of order; joint_2 locks all the same.',
        locks=(('joint_2', 1.4),),
        sim={'drop_fraction': 0.02, 'reorder_fraction': 0.02},
        seed=3,
    ),
    Case(
        'two_failures',
        'joint_1 locks, and joint_4 during the recovery: the rest is planned twice.',
        locks=(('joint_1', 1.2), ('joint_4', 2.6)),
        seed=4,
    ),
    Case(
        'stale_joint',
        'One joint drops out of the joint states for a while: STALE, never LOCKED.',
        corrupt=('missing', 'joint_4', 1.5),
        seed=5,
    ),
    Case(
        'bad_sensor',
        'One joint reports NaN for a while: SENSOR, never LOCKED.',
        corrupt=('nan', 'joint_2', 1.5),
        seed=6,
    ),
    Case(
        'runaway',
        'One joint leaves its command: RUNAWAY, and the re-planner halts.',
        corrupt=('runaway', 'joint_1', 1.5),
        seed=7,
    ),
    Case(
        'late_joint',
        'One joint falls behind its command by 0.1 s: late is not locked, and nothing may be '
        'reported.',
        corrupt=('late', 'joint_3', 1.0),
        seed=12,
    ),
    Case(
        'sluggish_joint',
        'One joint falls behind its command by a quarter of a second: SLUGGISH, never LOCKED, and '
        'the task goes on.',
        task='rounds',
        slow=('joint_2', 6.0, 0.25),
        seed=13,
    ),
    Case(
        'stuck_encoder',
        "One joint's encoder sticks while the joint moves on; a tracker sees the tool move: "
        'SENSOR, never LOCKED.',
        task='rounds',
        stuck=('joint_2', 6.0),
        sim={'tool_pose_rate': 50.0},
        monitor={'tool_pose_topic': 'tool_pose'},
        seed=14,
    ),
    Case(
        'manual_freeze',
        'An operator declares joint_5 frozen, and clears it once the arm has come to rest.',
        manual='joint_5',
        seed=9,
    ),
    Case(
        'urdf_arm',
        'A Franka Panda from its URDF: panda_joint4 locks during a position task.',
        arm='package://example-robot-data/robots/panda_description/urdf/panda.urdf',
        base='panda_link0',
        tip='panda_hand_tcp',
        task='urdf_task',
        locks=(('panda_joint4', 1.5),),
        seed=10,
    ),
    Case(
        'truncated_file',
        'The first case cut off in the middle and without metadata.yaml, as a crash leaves it.',
        truncate='locked_joint',
    ),
)
CASES = {case.name: case for case in _ALL}
