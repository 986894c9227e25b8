"""The paper's design templates: Tables 1 and 2, scaled until they cover given points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ft_manip_ros.core.arm_file import load_dh
from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.dh import DhTable
from ft_manip_ros.core.errors import InputError

# Arm files; both have the same FTWS, Table 2 in every orientation.
TEMPLATES = ('paredis_table_1', 'paredis_table_2')
VOLUME = 4.0 * np.pi * (np.sqrt(3.0) + 2.0 * np.pi / 3.0)


def in_template(points: Array, scale: float = 1.0) -> NDArray[np.bool_]:
    """Whether points (N, 3) (m) are in the FTWS of a template of this scale, in closed form.

    The solid of revolution rho <= 2 s, (rho - s)^2 + z^2 <= 4 s^2 about the first axis.
    """
    rho, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    inside: NDArray[np.bool_] = (rho <= 2.0 * scale) & (
        (rho - scale) ** 2 + z**2 <= 4.0 * scale**2
    )
    return inside


def smallest_scale(points: Array) -> float:
    """Smallest scale at which a template's FTWS covers points (N, 3) (m).

    The FTWS has no voids, so every larger scale covers them too (section 4).

    Raises
    ------
    InputError
        For no points, a wrong shape, NaN, or all points at the origin.
    """
    rows = np.asarray(points, dtype=float)
    if rows.ndim != 2 or rows.shape[1] != 3 or len(rows) == 0 or not np.isfinite(rows).all():
        raise InputError('points', 'must be finite, of shape (N, 3) with N >= 1')
    rho, z = np.hypot(rows[:, 0], rows[:, 1]), rows[:, 2]
    # (rho - s)^2 + z^2 = 4 s^2 solved for s > 0
    sphere = (np.sqrt(4.0 * rho**2 + 3.0 * z**2) - rho) / 3.0
    scale = float(np.maximum(rho / 2.0, sphere).max())
    if scale <= 0.0:
        raise InputError('points', 'all lie at the origin; every scale covers them')
    return scale


def cover(points: Array, template: str = TEMPLATES[0], clearance: float = 0.0) -> DhTable:
    """Return the template scaled to cover points (N, 3), and ``clearance`` (m) around them.

    Raises
    ------
    InputError
        For an unknown template or as `smallest_scale`.
    """
    if template not in TEMPLATES:
        raise InputError('template', f'is {template!r}; valid are {", ".join(TEMPLATES)}')
    if not (np.isfinite(clearance) and clearance >= 0.0):
        raise InputError('clearance', f'is {clearance}; must be a finite number >= 0 (m)')
    # Within s the boundary moves outwards by at least the distance times its smallest speed:
    # along rho it is 2 per unit of scale, along the sphere's normal at least 1.
    return load_dh(template).scaled(smallest_scale(points) + clearance)
