"""The recorded re-planner's collision checker, made again from what its bag keeps."""

from __future__ import annotations

import tempfile
from pathlib import Path

from ft_manip_ros.bags.replay_setup import ReplaySetup
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.collision_setup import CollisionOptions, make_checker

PARAMETERS = ('collision', 'padding', 'link_radius', 'obstacles', 'srdf')


def recorded_checker(setup: ReplaySetup, node: str, chain: SerialChain) -> CollisionChecker | None:
    """Return a checker as the node had it; None where it checked nothing.

    Files are taken from the bag, else from where the parameters name them. What cannot be had
    is left out, and `ReplaySetup.notes` says so.

    Raises
    ------
    InputError
        For a file that cannot be read, and where the arm's own bodies cannot be had: a URDF's
        meshes are not in the bag.
    """
    parameters = setup.parameters(node)
    if not parameters.get('collision'):
        return None
    default = CollisionOptions()
    with tempfile.TemporaryDirectory() as folder:
        options = CollisionOptions(
            float(parameters.get('padding', default.padding)),
            float(parameters.get('link_radius', default.link_radius)),
            *(
                _file(setup, node, kind, str(parameters.get(kind) or ''), Path(folder))
                for kind in ('obstacles', 'srdf')
            ),
        )
        arm = setup.arm_file(node, Path(folder))
        try:
            return make_checker(chain, arm, parameters.get('base') or None, options)
        except InputError as error:
            raise InputError(
                f'bag {setup.bag.path}',
                f'was recorded with collision checking, which cannot be made again: {error}; '
                'meshes are looked for in installed packages only (--override '
                'replanner.collision=false replays without)',
            ) from error


def _file(setup: ReplaySetup, node: str, kind: str, named: str, folder: Path) -> str:
    """Path of an obstacle file or SRDF; empty if the node had none, or it is gone."""
    copy = setup.attached(kind, node, folder)
    if copy is not None:
        return str(copy)
    if not named:
        return ''
    if Path(named).expanduser().is_file():
        setup.note(f'the {kind} of {node} are not in the bag: {named} is used')
        return named
    setup.note(f'the {kind} of {node} ({named}) are neither in the bag nor here: left out')
    return ''
