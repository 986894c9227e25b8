"""QoS profiles as rosbag2 (metadata version 9) writes them: names, not numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import yaml

from ft_manip_ros.bags.yaml_text import load_yaml

# rosbag2 writes "infinite" as this pair.
INFINITE = (2147483647, 4294967295)


@dataclass(frozen=True)
class QosProfile:
    """One publisher's offered QoS.

    Attributes
    ----------
    history, reliability, durability, liveliness
        Lower-case names, e.g. ``keep_last``, ``reliable``, ``transient_local``, ``automatic``.
    depth
        Queue length in messages.
    deadline, lifespan, lease
        (s, ns); `INFINITE` where none.
    """

    history: str = 'keep_last'
    depth: int = 10
    reliability: str = 'reliable'
    durability: str = 'volatile'
    liveliness: str = 'automatic'
    deadline: tuple[int, int] = INFINITE
    lifespan: tuple[int, int] = INFINITE
    lease: tuple[int, int] = INFINITE

    def as_dict(self) -> dict[str, Any]:
        """Keys and order of rosbag2's metadata version 9."""

        def time(pair: tuple[int, int]) -> dict[str, int]:
            return {'sec': pair[0], 'nsec': pair[1]}

        return {
            'history': self.history,
            'depth': self.depth,
            'reliability': self.reliability,
            'durability': self.durability,
            'deadline': time(self.deadline),
            'lifespan': time(self.lifespan),
            'liveliness': self.liveliness,
            'liveliness_lease_duration': time(self.lease),
            'avoid_ros_namespace_conventions': False,
        }


SENSOR_DATA = QosProfile(depth=5, reliability='best_effort')
RELIABLE = QosProfile()
LATCHED = QosProfile(depth=1, durability='transient_local')

# Numbers that rosbag2 wrote before version 9.
_OLD_NAMES: Mapping[str, Sequence[str]] = {
    'history': ('system_default', 'keep_last', 'keep_all', 'unknown'),
    'reliability': ('system_default', 'reliable', 'best_effort', 'unknown'),
    'durability': ('system_default', 'transient_local', 'volatile', 'unknown'),
}


def dump_profiles(profiles: Sequence[QosProfile]) -> str:
    """YAML list for a channel's ``offered_qos_profiles``."""
    return yaml.safe_dump([profile.as_dict() for profile in profiles], sort_keys=False)


def load_profiles(content: Any) -> tuple[QosProfile, ...]:
    """Profiles from a bag, by any rosbag2 version; unreadable ones are left out.

    Parameters
    ----------
    content
        YAML text, or the list that it stands for.
    """
    if isinstance(content, str):
        try:
            content = load_yaml(content)
        except yaml.YAMLError:
            return ()
    profiles = []
    for entry in content if isinstance(content, list) else ():
        if isinstance(entry, Mapping):
            profiles.append(_profile(entry))
    return tuple(profiles)


def _profile(entry: Mapping[str, Any]) -> QosProfile:
    found: dict[str, Any] = {}
    for key, names in _OLD_NAMES.items():
        value = entry.get(key)
        if isinstance(value, int) and 0 <= value < len(names):
            found[key] = names[value]
        elif isinstance(value, str):
            found[key] = value
    if isinstance(entry.get('depth'), int):
        found['depth'] = entry['depth']
    return QosProfile(**{**asdict(QosProfile()), **found})
