"""What the design search can be told, checked at the door."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ft_manip_ros.core.design.inner import INNER_METHODS
from ft_manip_ros.core.design.space import FAMILIES
from ft_manip_ros.core.errors import InputError

METHODS = ('worst_cases', 'annealing', 'paredis_1994')
EXECUTORS = ('threads', 'processes')
MIDDLE_METHODS = ('march', 'p_star', 'grid')


@dataclass(frozen=True)
class DesignSettings:
    """Settings of `search.design_arm`.

    Attributes
    ----------
    method
        ``worst_cases``: descent over the DH table on a pool of worst cases; ``annealing``:
        equation 10 with marched worst cases and early rejection; ``paredis_1994``: the paper's
        annealing, P* and hybrid minimisation.
    inner, middle
        Inner and middle method; empty for the method's own choice.
    seed
        Same seed, same result, as long as the time budget does not run out.
    time_budget
        s; the search ends with its best design when it is spent.
    max_segments
        Units of work after which the search ends; 0 for no such end.
    slots
        Chains that advance side by side; part of what a seed means, unlike ``workers``.
    workers
        Segments worked on at once; on a cluster, segments handed out at once.
    executor
        ``threads`` or ``processes`` on this machine.
    scheduler
        Address of a Dask scheduler; empty for this machine.
    angles
        Grid of frozen angles per frozen joint; 0 for a choice by order.
    restarts
        Random starts spent on a frozen angle before it counts as failing; 0 for a choice by
        method.
    margin
        Every goal is searched together with points this far around it, as a share of the
        farthest goal's distance, so that the proof does not meet a design on the boundary.
    ball
        Radius (m) of the ball that the design must reach whole, for goals without a region.
    limit_margin
        rad by which moving joints keep away from their limits during the search.
    bounds, fixed, alpha_step, family, max_length
        See `space.design_space`; each over the specification's own where given, the shorter
        length of the two.
    shorten
        Spend what is left of the time budget on shorter proved designs.
    prove
        False skips the proof; nothing is then announced as proved.
    """

    method: str = 'worst_cases'
    inner: str = ''
    middle: str = ''
    seed: int = 0
    time_budget: float = 60.0
    max_segments: int = 0
    slots: int = 4
    workers: int = 1
    executor: str = 'threads'
    scheduler: str = ''
    angles: int = 0
    restarts: int = 0
    margin: float = 0.04
    ball: float = 0.0
    limit_margin: float = np.deg2rad(3.0)
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)
    alpha_step: float = 0.0
    family: str = ''
    max_length: float = np.inf
    shorten: bool = False
    prove: bool = True

    @property
    def inner_method(self) -> str:
        """The inner method, the search method's own choice where none was given."""
        return self.inner or ('hybrid' if self.method == 'paredis_1994' else 'newton')

    @property
    def middle_method(self) -> str:
        """The middle method, the search method's own choice where none was given."""
        return self.middle or ('p_star' if self.method == 'paredis_1994' else 'march')

    def __post_init__(self) -> None:
        _one_of('method', self.method, METHODS)
        if self.family:
            _one_of('family', self.family, FAMILIES)
        _one_of('executor', self.executor, EXECUTORS)
        if self.inner:
            _one_of('inner', self.inner, INNER_METHODS)
        if self.middle:
            _one_of('middle', self.middle, MIDDLE_METHODS)
        for name, least in (
            ('seed', 0),
            ('max_segments', 0),
            ('slots', 1),
            ('workers', 1),
            ('angles', 0),
            ('restarts', 0),
        ):
            if getattr(self, name) < least:
                raise InputError(name, f'is {getattr(self, name)}; must be at least {least}')
        if self.angles == 1:
            raise InputError('angles', 'is 1; at least 2 are needed (0: choose by order)')
        if not (np.isfinite(self.time_budget) and self.time_budget > 0.0):
            raise InputError('time_budget', f'is {self.time_budget}; must be > 0 s')
        if not 0.0 <= self.margin < 1.0:
            raise InputError('margin', f'is {self.margin}; must be from 0 to below 1')
        if not (np.isfinite(self.ball) and self.ball >= 0.0):
            raise InputError('ball', f'is {self.ball}; must be finite and at least 0 m')
        if not 0.0 <= self.limit_margin < 1.0:
            raise InputError('limit_margin', f'is {self.limit_margin}; must be 0 to 1 rad')


def _one_of(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise InputError(name, f'is {value!r}; must be one of {", ".join(choices)}')
