"""What the FTWS engine answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any


class Verdict(str, Enum):
    """Never a bare bool: what is not proved is UNDECIDED."""

    MEMBER = 'member'
    NON_MEMBER = 'non_member'
    UNDECIDED = 'undecided'


@dataclass(frozen=True)
class FtwsResult:
    """Verdict on one point or pose.

    Attributes
    ----------
    point
        The goal's position (m).
    verdict, reason
        The answer and, in words, what it rests on.
    joints, angles
        NON_MEMBER: the failed joints and the positions (rad or m) at which the goal is lost.
        UNDECIDED: where the proof failed, if at a known place.
    residual
        NON_MEMBER: the proved distance (m) by which that ROD misses the goal; UNDECIDED: the
        worst residual seen; MEMBER: 0.
    margin
        Radius (m) of the ball around the goal with the same proved verdict; 0 if not worked out.
    closed_form
        Whether the verdict rests on the closed form of planar arms without limits.
    tolerated
        Order 1: per joint, intervals of frozen positions at which the goal is proved reachable.
    surviving_fraction
        Order 1: their share of the joint's operating range.
    elapsed_s
        Wall time of this goal (s).
    """

    point: tuple[float, float, float]
    verdict: Verdict
    reason: str
    joints: tuple[str, ...] = ()
    angles: tuple[float, ...] = ()
    residual: float = 0.0
    margin: float = 0.0
    tolerated: Mapping[str, list[tuple[float, float]]] = field(default_factory=dict)
    surviving_fraction: Mapping[str, float] = field(default_factory=dict)
    elapsed_s: float = 0.0
    closed_form: bool = False

    def to_json(self) -> dict[str, Any]:
        """Return the answer as the command line prints it.

        ``margin`` is null where no ball was worked out, or none was proved.
        """
        return {
            'point': list(self.point),
            'verdict': self.verdict.value,
            'joints': list(self.joints),
            'angles': list(self.angles),
            'residual': self.residual,
            'margin': self.margin if self.margin > 0.0 else None,
            'tolerated': {name: [list(i) for i in rows] for name, rows in self.tolerated.items()},
            'surviving_fraction': dict(self.surviving_fraction),
            'reason': self.reason,
            'elapsed_s': self.elapsed_s,
        }
