"""Joints that mimic another one: checked against their leader, since nobody commands them.

A mimic joint (a finger, a parallelogram) has no command and cannot fail alone in the sense of the
arm, so it is no joint of it. What can be told is whether it still does what its leader does. Where
it does not, either its reading is wrong or its linkage is broken; its leader is judged by its own
command, and is not suspected for it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ft_manip_ros.core.config_files import find_config
from ft_manip_ros.core.detection.settings import MonitorSettings
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.urdf_mimic import followed
from ft_manip_ros.core.urdf_text import parse

_TIMES = 3.0  # times the slack: play and compliance of a linkage
_CONFIRM = 100_000_000  # ns
_CONFIRM_SAMPLES = 3
_TOGETHER = 200_000_000  # ns within which both must have been read


@dataclass(frozen=True)
class Mimic:
    """A joint that stands where ``multiplier`` times its leader's position, plus ``offset``, is.

    Attributes
    ----------
    name, leader
        Joint names.
    multiplier, offset
        As in the URDF; offset in rad or m.
    prismatic
        Whether it slides.
    """

    name: str
    leader: str
    multiplier: float
    offset: float
    prismatic: bool


@dataclass(frozen=True)
class MimicReport:
    """What is known of a mimic joint.

    Attributes
    ----------
    mimic
        The joint.
    position, expected
        Latest reading, and where its leader would have it, rad or m; NaN before any is known.
    agrees
        False once they disagreed over the confirm window, until they agree again.
    """

    mimic: Mimic
    position: float
    expected: float
    agrees: bool

    @property
    def text(self) -> str:
        """One sentence for a person."""
        what = f'mimics {self.mimic.leader}'
        if math.isnan(self.position) or math.isnan(self.expected):
            return f'{what}: not read yet, not checked'
        if self.agrees:
            return f'{what} and agrees with it; judged with it, not by itself'
        away = abs(self.position - self.expected)
        return f'{what} and is {away:.3g} away from it: reading or linkage not to be believed'


def mimics_of(arm: str, leaders: Iterable[str]) -> list[Mimic]:
    """Mimic joints of an arm, as `load_arm` takes it, that follow one of ``leaders``.

    Only URDFs have any. One that mimics a mimic joint follows that one's leader, as in the chain
    (`urdf_mimic.followed`).

    Raises
    ------
    InputError
        For a multiplier or offset that is no finite number, or a joint that mimics itself or one
        that does not exist.
    """
    text = arm
    if not arm.lstrip().startswith('<'):
        path = find_config('arms', arm)
        if path.suffix not in ('.urdf', '.xml'):
            return []
        text = path.read_text(encoding='utf-8')
    leaders = set(leaders)
    root = parse(text, 'URDF')
    joints = {joint.get('name', ''): joint for joint in root.findall('joint')}
    found = []
    for name, joint in joints.items():
        if joint.find('mimic') is None:
            continue
        try:
            leader, multiplier, offset = followed(joints, name, 'URDF')
        except InputError:
            raise
        except ValueError as error:
            raise InputError(f'joint {name!r}: mimic', f'{error}') from error
        if leader not in leaders:
            continue
        for key, value in (('multiplier', multiplier), ('offset', offset)):
            if not math.isfinite(value):
                raise InputError(
                    f'joint {name!r}: mimic {key}', f'is {value}; a finite number is needed'
                )
        found.append(Mimic(name, leader, multiplier, offset, joint.get('type') == 'prismatic'))
    return found


class MimicWatch:
    """Compares mimic joints with their leaders, message by message.

    Parameters
    ----------
    mimics
        Joints to watch.
    settings
        Slacks of the fault monitor, of which some times are allowed.
    """

    def __init__(self, mimics: Iterable[Mimic], settings: MonitorSettings) -> None:
        self.mimics = tuple(mimics)
        self.names = frozenset(mimic.name for mimic in self.mimics)
        self._reach = [
            _TIMES * (settings.slack_prismatic if mimic.prismatic else settings.slack_revolute)
            for mimic in self.mimics
        ]
        self._leaders = {mimic.leader for mimic in self.mimics}
        self._read: dict[str, tuple[int, float]] = {}
        # For each: how often in a row, and since when (ns), it disagrees; whether it counts.
        self._runs = [(0, 0, True) for _ in self.mimics]

    def sample(self, stamp: int, positions: Mapping[str, float]) -> None:
        """Take the positions (rad or m) of one message; those of other joints are passed over."""
        fresh = set()
        for name, value in positions.items():
            if (name in self.names or name in self._leaders) and math.isfinite(value):
                self._read[name] = (stamp, float(value))
                fresh.add(name)
        for k, mimic in enumerate(self.mimics):
            if mimic.name not in fresh and mimic.leader not in fresh:
                continue
            here, there = self._read.get(mimic.name), self._read.get(mimic.leader)
            if here is None or there is None or abs(here[0] - there[0]) > _TOGETHER:
                continue
            away = abs(here[1] - mimic.multiplier * there[1] - mimic.offset)
            if away <= self._reach[k]:
                self._runs[k] = (0, 0, True)
                continue
            count, since, agrees = self._runs[k]
            since = stamp if count == 0 or stamp < since else since
            lasting = count + 1 >= _CONFIRM_SAMPLES and stamp - since >= _CONFIRM
            self._runs[k] = (count + 1, since, agrees and not lasting)

    def reports(self) -> list[MimicReport]:
        """What is known of each mimic joint."""
        out = []
        for mimic, (_, _, agrees) in zip(self.mimics, self._runs, strict=True):
            position = self._read.get(mimic.name, (0, math.nan))[1]
            leader = self._read.get(mimic.leader, (0, math.nan))[1]
            expected = mimic.multiplier * leader + mimic.offset
            out.append(MimicReport(mimic, position, expected, agrees))
        return out
