"""A design task as the search sees it: goals, limits, frozen sets and the space of tables."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from ft_manip_ros.core.chain import FULL_TURN, Array, Joint
from ft_manip_ros.core.design.dh_kernels import (
    AXIS,
    POSE,
    POSITION,
    DhRows,
    Goals,
    Limits,
    make_rows,
)
from ft_manip_ros.core.design.frozen_sets import FrozenSets, frozen_sets
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.design.space import DesignSpace, design_space
from ft_manip_ros.core.dh import DhTable
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import DesignSpec, Goal, Task

# Penalty (m^2 + rad^2) that counts as reached: well inside the 1e-6 m of the verdicts.
ZERO = 1e-14
# Grid of frozen angles by order of fault tolerance: the nodes grow as its power.
_ANGLES = {1: 33, 2: 13, 3: 7}
_MAX_NODES = 200_000


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """Everything a worker needs; plain arrays and frozen dataclasses, so it can be sent.

    Attributes
    ----------
    goals, limits
        The task's own goals and joint limits, as the objective of equation 7 counts them.
    reach
        Distance of the farthest goal from the base, m.
    """

    task: Task
    spec: DesignSpec
    settings: DesignSettings
    space: DesignSpace
    sets: FrozenSets
    goals: Goals
    limits: Limits
    reach: float

    def guarded(self, share: float) -> tuple[Goals, Limits]:
        """Goals and limits with ``share`` of the settings' margins.

        The task's own goals come first, then the points around each; the limits are narrower
        for moving joints only.
        """
        # The corners must lie well outside a ball for all of it to be reached.
        radius = share * self.settings.margin * self.reach + 1.5 * self.settings.ball
        return (
            _guarded(self.goals, radius),
            _limits(self.spec, share * self.settings.limit_margin),
        )

    @property
    def goal_count(self) -> int:
        """Number of goals of the task."""
        return len(self.goals.positions)

    @property
    def nodes(self) -> int:
        """Grid nodes of one set of frozen joints."""
        return int(self.sets.angles.shape[1] ** self.spec.order)

    def rows(self, p: Array) -> DhRows:
        """Table of parameters ``p`` (3n,) as the kernels read it."""
        n = self.spec.dof
        return make_rows(p[:n], p[n : 2 * n], p[2 * n :])

    def table(self, p: Array) -> DhTable:
        """Table of parameters ``p`` (3n,) as an arm with the task's joint limits."""
        n = self.spec.dof
        joints = tuple(Joint(f'joint_{i + 1}', self.spec.lower, self.spec.upper) for i in range(n))
        name = f'design_{self.task.name}'
        return DhTable(name, joints, p[:n], p[n : 2 * n], p[2 * n :], np.zeros(n))

    def parameters(self, table: DhTable) -> Array:
        """Parameters (3n,) of a table of revolute joints without offsets.

        Raises
        ------
        InputError
            For another number of joints, a prismatic joint or an offset.
        """
        if table.n != self.spec.dof:
            raise InputError(
                f'arm {table.name!r}', f'has {table.n} joints; the task asks for {self.spec.dof}'
            )
        if any(joint.prismatic for joint in table.joints) or np.any(table.offset != 0.0):
            raise InputError(f'arm {table.name!r}', 'must be revolute and without offsets')
        return np.concatenate([table.d, table.a, table.alpha])


def design_problem(
    task: Task, spec: DesignSpec | None = None, settings: DesignSettings | None = None
) -> DesignProblem:
    """Check a task and its specification and return it as the search sees it.

    Raises
    ------
    InputError
        Where nothing says how many joints to use, or the grid of frozen angles grows too large.
    """
    settings = settings or DesignSettings()
    spec = spec or task.design
    if spec is None:
        raise InputError(f'task {task.name!r}', 'has no design section; give dof and limits')
    n, order = spec.dof, spec.order
    nodes = settings.angles or _ANGLES.get(order, 5)
    if comb(n, order) * nodes**order > _MAX_NODES:
        raise InputError(
            'angles', f'{nodes} for {order} of {n} frozen joints make more than {_MAX_NODES} RODs'
        )
    reach = max(float(np.linalg.norm(goal.position)) for goal in task.goals)
    bounds = {**(spec.bounds or {}), **settings.bounds}
    space = design_space(
        n,
        reach,
        bounds=bounds,
        fixed=settings.fixed,
        alpha_step=settings.alpha_step,
        family=settings.family,
        max_length=settings.max_length,
    )
    limits = _limits(spec, 0.0)
    return DesignProblem(
        task,
        spec,
        settings,
        space,
        frozen_sets(limits, order, nodes),
        pack_goals(task.goals),
        limits,
        reach,
    )


def pack_goals(goals: tuple[Goal, ...]) -> Goals:
    """Return goals as the kernels read them."""
    modes = [
        POSITION if goal.orientation is None else AXIS if goal.free_axis else POSE
        for goal in goals
    ]
    return Goals(
        np.array([goal.position for goal in goals], dtype=float),
        np.array([np.eye(3) if g.orientation is None else g.orientation for g in goals]),
        np.array(modes, dtype=np.int64),
    )


def _limits(spec: DesignSpec, margin: float) -> Limits:
    n = spec.dof
    limited = spec.upper - spec.lower < FULL_TURN - 1e-6
    inset = min(margin, 0.25 * (spec.upper - spec.lower)) if limited else 0.0
    return Limits(
        np.full(n, spec.lower + inset),
        np.full(n, spec.upper - inset),
        np.full(n, limited),
        np.full(n, spec.lower),
        np.full(n, spec.upper),
    )


def _guarded(goals: Goals, radius: float) -> Goals:
    """Return the goals, then the corners of a tetrahedron of ``radius`` (m) around each."""
    if radius <= 0.0:
        return goals
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)
    positions = [goals.positions] + [goals.positions + radius * corner for corner in corners]
    copies = len(positions)
    return Goals(
        np.ascontiguousarray(np.concatenate(positions)),
        np.ascontiguousarray(np.tile(goals.orientations, (copies, 1, 1))),
        np.tile(goals.modes, copies),
    )
