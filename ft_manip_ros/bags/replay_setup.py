"""What a replay needs beside the messages: parameters, arms, topic names of the nodes."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from ft_manip_ros.bags.reader import Bag
from ft_manip_ros.bags.yaml_text import load_yaml
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.errors import InputError

_PARAMETERS = 'parameters/'
_DESCRIPTION = ('robot_description', 'std_msgs/msg/String')


@dataclass
class ReplaySetup:
    """Where a bag keeps what the nodes were told, with what the caller says instead.

    Attributes
    ----------
    bag
        The bag.
    overrides
        Parameter values that replace the recorded ones: by name, or by ``node.name``.
    arm
        Arm file, name or URDF to use instead of the recorded one.
    notes
        What was missing and what stood in for it.
    """

    bag: Bag
    overrides: Mapping[str, Any] = field(default_factory=dict)
    arm: str = ''
    notes: list[str] = field(default_factory=list)

    def topic(self, name: str, type_name: str) -> str | None:
        """Topic of this relative name and type, in whatever namespace; None if there is none.

        Raises
        ------
        InputError
            If several namespaces have it.
        """
        found = [
            topic
            for topic, info in self.bag.topics.items()
            if info.type_name == type_name and (topic == name or topic.endswith(f'/{name}'))
        ]
        if len(found) > 1:
            raise InputError(
                f'bag {self.bag.path}', f'has several topics {name}: {", ".join(sorted(found))}'
            )
        return found[0] if found else None

    def parameters(self, node: str) -> dict[str, Any]:
        """Recorded parameters of a node with the overrides applied; empty if none were recorded.

        Raises
        ------
        InputError
            For a recorded value that is not readable.
        """
        values: dict[str, Any] = {}
        for name, recorded in self.bag.provenance.items():
            if name.startswith(_PARAMETERS) and name.rsplit('/', 1)[-1] == node:
                for key, text in recorded.items():
                    try:
                        values[key] = load_yaml(text)
                    except yaml.YAMLError:
                        raise InputError(
                            f'{self.bag.path}: parameter {key} of {node}', f'is {text!r}'
                        ) from None
        if not values:
            self.note(f'the bag has no parameters of {node}: its defaults are used')
        for key, value in self.overrides.items():
            owner, _, name = key.rpartition('.')
            if owner in ('', node):
                values[name] = value
        return values

    def chain(self, node: str) -> SerialChain:
        """Arm of a node: the one given, else the file in the bag, else the name, else the URDF.

        Raises
        ------
        InputError
            If none of these is there or readable.
        """
        parameters = self.parameters(node)
        base, tip = parameters.get('base') or None, parameters.get('tip') or None
        with tempfile.TemporaryDirectory() as folder:
            return load_arm(self.arm_file(node, Path(folder)), base=base, tip=tip)

    def attached(self, kind: str, node: str, folder: Path) -> Path | None:
        """Copy the file of this kind that a node was told of out of the bag; None if not there."""
        for name, (_, content) in self.bag.attachments.items():
            path = Path(name)
            if name.startswith(f'{kind}/') and path.stem == node:
                copy = Path(folder, f'{kind}_{path.name}')
                copy.write_bytes(content)
                return copy
        return None

    def arm_file(self, node: str, folder: Path) -> str:
        """Return what `load_arm` is to read for a node, as `chain`; files are put in a folder.

        Raises
        ------
        InputError
            If the bag says nothing of it.
        """
        parameters = self.parameters(node)
        if self.arm:
            return self.arm
        copy = self.attached('arm', node, folder)
        if copy is not None:
            return str(copy)
        # With 'topic' the node read the description too.
        if parameters.get('arm') not in (None, '', 'topic'):
            self.note(f'the arm file of {node} is not in the bag: {parameters["arm"]} is used')
            return str(parameters['arm'])
        description = self.topic(*_DESCRIPTION)
        message = next(self.bag.messages([description]), None) if description else None
        if message is not None:
            self.note(f'the arm of {node} is taken from robot_description')
            return str(self.bag.decode_expected(message).data)
        raise InputError(
            f'bag {self.bag.path}',
            f'says nothing of the arm of {node} (no arm file, no parameters, no '
            'robot_description): name it with --arm',
        )

    def check_overrides(self, known: Mapping[str, set[str]]) -> None:
        """Raise `InputError` for an override that no replayed node has."""
        names = sorted({name for settings in known.values() for name in settings})
        for key in self.overrides:
            owner, _, name = key.rpartition('.')
            owners = [owner] if owner else list(known)
            if not any(name in known.get(node, ()) for node in owners):
                raise InputError(
                    f'override {key!r}', f'is no parameter of the replay; there are {names}'
                )

    def note(self, text: str) -> None:
        """Say, once, what was missing and what stands in for it."""
        if text not in self.notes:
            self.notes.append(text)
