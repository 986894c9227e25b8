"""What the fault monitor says of a joint: states, causes, edges and reports."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class JointState(IntEnum):
    """State of one joint; the numbers are those of ``ft_manip_interfaces/msg/JointFault``."""

    OK = 0
    IDLE = 1
    SUSPECT = 2
    LOCKED = 3
    STALE = 4
    SENSOR = 5
    RUNAWAY = 6
    PROVING = 7
    SLUGGISH = 8


class Cause(IntEnum):
    """Why a joint is in its state."""

    FOLLOWS = 0
    AT_REST = 1
    FIRST_EVIDENCE = 2
    NO_MOTION = 3
    NO_MOTION_HIGH_EFFORT = 4
    STOPPED_AMONG_MOVING = 5
    ARM_NOT_EXECUTING = 6
    NO_SAMPLES = 7
    STAMPS_NOT_ADVANCING = 8
    PAYLOAD_REPEATS = 9
    NOT_FINITE = 10
    JUMP = 11
    OUT_OF_RANGE = 12
    VELOCITY_DISAGREES = 13
    DEAD_CHANNEL = 14
    MOVES_UNCOMMANDED = 15
    MOVES_AGAINST_COMMAND = 16
    MOVED_WHILE_LOCKED = 17
    CLEARED = 18
    LATE = 19
    JERKS = 20
    MANUAL = 21
    UNSEEN_COMMANDS = 22
    RESTORED = 23
    NO_SENSOR = 24
    ENCODER_STUCK = 25
    TOOL_AWAITED = 26
    TOOL_UNCLEAR = 27
    TOOL_STANDS = 28


class ToolWord(IntEnum):
    """What the tool's motion says of a joint that is commanded and whose encoder stands."""

    UNASKED = 0  # no pose yet since it is suspected
    AWAITED = 1  # too little motion yet to tell
    NOTHING = 2  # and it will not tell
    STOOD = 3  # the joint stands, too
    MOVED = 4  # the joint moves
    UNCLEAR = 5  # the tool moves as no suspect alone, or as more than one would have it


CAUSE_TEXT: dict[Cause, str] = {
    Cause.FOLLOWS: 'follows its command',
    Cause.AT_REST: 'not commanded to move',
    Cause.FIRST_EVIDENCE: 'command moves on and the joint shows no motion yet',
    Cause.NO_MOTION: 'commanded to move and does not',
    Cause.NO_MOTION_HIGH_EFFORT: 'commanded to move and does not, with more effort than ever seen',
    Cause.STOPPED_AMONG_MOVING: 'stopped dead while the other joints moved on',
    Cause.ARM_NOT_EXECUTING: 'no commanded joint moves: the arm does not execute its commands',
    Cause.NO_SAMPLES: 'no fresh sample while other joints report',
    Cause.STAMPS_NOT_ADVANCING: 'its stamps repeat or go back',
    Cause.PAYLOAD_REPEATS: 'the whole message repeats bit for bit while its stamp advances',
    Cause.NOT_FINITE: 'position is NaN or infinite',
    Cause.JUMP: 'position jumped further than its velocity allows',
    Cause.OUT_OF_RANGE: 'position is outside the physical range',
    Cause.VELOCITY_DISAGREES: 'position stands still while the reported velocity says it moves',
    Cause.DEAD_CHANNEL: 'position repeats bit for bit on a channel that never does',
    Cause.MOVES_UNCOMMANDED: 'moves while commanded to rest',
    Cause.MOVES_AGAINST_COMMAND: 'moves away from its command',
    Cause.MOVED_WHILE_LOCKED: 'was locked and moves: not a frozen joint any more',
    Cause.CLEARED: 'cleared; has to follow a commanded motion first',
    Cause.LATE: 'follows its command later than it used to',
    Cause.JERKS: 'follows its command by jerks',
    Cause.MANUAL: 'declared frozen',
    Cause.UNSEEN_COMMANDS: 'several joints move without a command: others are commanding the arm',
    Cause.NO_SENSOR: 'has read exactly zero ever since, beside encoders that flicker',
    Cause.RESTORED: 'restored from the state file',
    Cause.ENCODER_STUCK: "encoder stands still while the tool's motion shows that the joint moves",
    Cause.TOOL_AWAITED: "commanded to move and does not show it; the tool's motion is waited for",
    Cause.TOOL_UNCLEAR: 'commanded to move and does not; the tool moves, and it is unclear which '
    'joint moves it',
    Cause.TOOL_STANDS: 'commanded to move and does not, and the tool stands as well',
}

LATCHED = frozenset({JointState.LOCKED, JointState.RUNAWAY})


@dataclass(frozen=True)
class Report:
    """What is known of one joint at one moment; the fields of a JointFault message.

    Attributes
    ----------
    name
        Joint name.
    state, cause
        State and one sentence for a person.
    manual
        Declared by hand rather than detected.
    frozen_position, frozen_position_sigma
        Where it is frozen and one standard deviation (rad or m); NaN unless LOCKED.
    first_evidence, confirmed
        Stamps (ns) of the first sample that spoke for the fault and of the one that confirmed
        it; 0 if none.
    position, commanded_position
        Last believed position and its command (rad or m); NaN if none is known.
    residual
        Commanded motion that the joint has not shown, rad or m.
    threshold
        What the residual is compared with, rad or m.
    noise
        Learned position noise, one standard deviation, rad or m; NaN before any is learned.
    suspects
        How often the joint was suspected and moved on by itself.
    previous, changed
        State before the latest change, and the stamp (ns) of that change; 0 if none.
    """

    name: str
    state: JointState
    cause: str
    manual: bool
    frozen_position: float
    frozen_position_sigma: float
    first_evidence: int
    confirmed: int
    position: float
    commanded_position: float
    residual: float
    threshold: float
    noise: float
    suspects: int
    previous: JointState
    changed: int


@dataclass(frozen=True)
class Edge:
    """One change of state of one joint, at the sample with stamp ``stamp`` (ns)."""

    stamp: int
    previous: JointState
    report: Report
