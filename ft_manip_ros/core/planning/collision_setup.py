"""From what a user can say about an arm's surroundings to a collision checker."""

from __future__ import annotations

from dataclasses import dataclass

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.config_files import find_config
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.link_capsules import capsule_model
from ft_manip_ros.core.planning.obstacles import load_obstacles
from ft_manip_ros.core.planning.urdf_bodies import urdf_model


@dataclass(frozen=True)
class CollisionOptions:
    """What to check.

    Attributes
    ----------
    padding
        Distance (m) that bodies have to keep.
    link_radius
        Of the capsules along the links (m), for arms without collision bodies of their own;
        for a URDF, 0 means its own bodies.
    obstacles
        Path of an obstacle file; empty for none.
    srdf
        Path of an SRDF whose disabled pairs are respected; empty for none.
    """

    padding: float = 0.01
    link_radius: float = 0.0
    obstacles: str = ''
    srdf: str = ''


def make_checker(
    chain: SerialChain, arm: str, base: str | None, options: CollisionOptions
) -> CollisionChecker:
    """Return a checker for an arm as `load_arm` was told of it.

    Raises
    ------
    InputError
        For unreadable files, missing meshes, and an arm that has no bodies where no
        ``link_radius`` gives it some.
    """
    around = load_obstacles(options.obstacles) if options.obstacles else ()
    if options.link_radius > 0.0:
        return CollisionChecker(capsule_model(chain, options.link_radius, around, options.padding))
    text = arm
    if not arm.lstrip().startswith('<'):
        path = find_config('arms', arm)
        if path.suffix not in ('.urdf', '.xml'):
            raise InputError(
                'link_radius', f'is 0, and {path.name} has no bodies; give a radius (m)'
            )
        text = path.read_text(encoding='utf-8')
    bodies = urdf_model(chain, text, base, around, options.srdf or None, padding=options.padding)
    if bodies.own == 0:
        raise InputError(
            'link_radius', 'is 0, and the URDF has no collision bodies; give a radius'
        )
    return CollisionChecker(bodies)
