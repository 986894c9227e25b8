"""What a bag says and what its replay says, in one form: compared, shown, summed up."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

Value = str | int | float | tuple[float, ...]

# Digits kept of floats in the digest: coarse against rounding on other machines, fine against
# any change that matters (um, urad).
_DIGITS = 6


@dataclass(frozen=True)
class Finding:
    """One verdict, fault or plan.

    Attributes
    ----------
    kind
        'fault', 'verdict' or 'plan'.
    stamp
        When, ns.
    about
        What it is about, e.g. a joint or a point: findings are compared with those of the same.
    values
        The conclusion: it lasts, whatever version replays the bag.
    details
        What it rests on: the same for the same version, but a better core may prove a wider
        margin or find a shorter way.
    """

    kind: str
    stamp: int
    about: str
    values: Mapping[str, Value] = field(default_factory=dict)
    details: Mapping[str, Value] = field(default_factory=dict)

    def text(self) -> str:
        """One line for a person."""
        found = {**self.values, **self.details}
        shown = ', '.join(f'{k} {_show(v)}' for k, v in found.items() if v not in ('', ()))
        return f'{self.about}: {shown}' if shown else self.about

    def canonical(self) -> list[object]:
        """Form that the digest is made of; the same wherever it is computed."""
        return [
            self.kind,
            self.stamp,
            self.about,
            {key: _rounded(value) for key, value in sorted(self.values.items())},
        ]


@dataclass(frozen=True)
class Difference:
    """A finding on which recording and replay disagree; None where one has nothing."""

    recorded: Finding | None
    replayed: Finding | None
    fields: tuple[str, ...] = ()

    @property
    def stamp(self) -> int:
        """When, ns."""
        finding = self.recorded or self.replayed
        return finding.stamp if finding else 0


@dataclass(frozen=True)
class Tolerance:
    """How far recording and replay may be apart.

    Attributes
    ----------
    time
        Of stamps (s). A node and the recorder receive messages of different topics in slightly
        different order, which can move a change of state by a sample or two.
    pairing
        How far apart (s) two findings may be and still be taken for the same one.
    numbers
        Largest difference by the name of the value.
    exact
        Compare details, too.
    """

    time: float = 0.05
    pairing: float = 0.5
    numbers: Mapping[str, float] = field(default_factory=dict)
    exact: bool = False


def compare(
    recorded: Sequence[Finding], replayed: Sequence[Finding], tolerance: Tolerance
) -> list[Difference]:
    """Pair findings about the same thing in order of time; return what has no equal partner."""
    differences = []
    abouts = {(f.kind, f.about): None for f in (*recorded, *replayed)}
    for kind, about in abouts:
        old = [f for f in recorded if (f.kind, f.about) == (kind, about)]
        new = [f for f in replayed if (f.kind, f.about) == (kind, about)]
        differences += _pair(old, new, tolerance)
    return sorted(differences, key=lambda d: d.stamp)


def digest(findings: Sequence[Finding]) -> str:
    """SHA-256 over all findings in order of time."""
    ordered = sorted(findings, key=lambda f: (f.stamp, f.kind, f.about))
    text = json.dumps([f.canonical() for f in ordered], separators=(',', ':'))
    return hashlib.sha256(text.encode()).hexdigest()


def _pair(
    old: Sequence[Finding], new: Sequence[Finding], tolerance: Tolerance
) -> list[Difference]:
    differences: list[Difference] = []
    left = list(new)
    unpaired = []
    for finding in old:
        equal = [f for f in _near(finding, left, tolerance) if not _unequal(finding, f, tolerance)]
        if equal:
            left.remove(equal[0])
        else:
            unpaired.append(finding)
    for finding in unpaired:
        near = _near(finding, left, tolerance)
        if near:
            left.remove(near[0])
            differences.append(Difference(finding, near[0], _unequal(finding, near[0], tolerance)))
        else:
            differences.append(Difference(finding, None))
    return differences + [Difference(None, finding) for finding in left]


def _near(finding: Finding, others: Sequence[Finding], tolerance: Tolerance) -> list[Finding]:
    """Those that may be the same thing, the nearest in time first."""
    near = [f for f in others if abs(f.stamp - finding.stamp) <= tolerance.pairing * 1e9]
    return sorted(near, key=lambda f: abs(f.stamp - finding.stamp))


def _unequal(old: Finding, new: Finding, tolerance: Tolerance) -> tuple[str, ...]:
    late = ('time',) if abs(new.stamp - old.stamp) > tolerance.time * 1e9 else ()
    a, b = dict(old.values), dict(new.values)
    if tolerance.exact:
        a.update(old.details)
        b.update(new.details)
    return late + tuple(
        key
        for key in {**a, **b}
        if not _equal(a.get(key, ''), b.get(key, ''), tolerance.numbers.get(key, 0.0))
    )


def _equal(a: Value, b: Value, within: float) -> bool:
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(_equal(x, y, within) for x, y in zip(a, b, strict=True))
    if isinstance(a, (int, float)) and isinstance(b, (int, float)):
        return (math.isnan(a) and math.isnan(b)) or abs(a - b) <= within
    return a == b


def _rounded(value: Value) -> object:
    if isinstance(value, tuple):
        return [_rounded(v) for v in value]
    if isinstance(value, float):
        # Text, and never "-0": JSON must not depend on how a machine prints floats.
        return f'{round(value, _DIGITS) + 0.0:.{_DIGITS}f}'
    return value


def _show(value: Value) -> str:
    if isinstance(value, float):
        return f'{value:.5g}'
    if isinstance(value, tuple):
        return '(' + ', '.join(f'{v:.4g}' for v in value) + ')'
    return str(value)
