"""A design task as the search sees it: goals, limits, frozen sets and the space of tables."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.design.dh_kernels import DhRows, Goals, IntArray, Limits, make_rows
from ft_manip_ros.core.design.frozen_sets import FrozenSets, frozen_sets
from ft_manip_ros.core.design.search_goals import guarded_goals, pack_task, with_balls
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.design.space import DesignSpace, design_space
from ft_manip_ros.core.dh import DhTable
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import DesignSpec, Task
from ft_manip_ros.core.joint import FULL_TURN, Joint

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
    task
        With a region around every goal that stands for a volume.
    goals, limits
        Points and joint limits, as the objective of equation 7 counts them: the task's own
        goals, then points on the surfaces of their regions.
    owners : ndarray, shape (P,)
        The goal of the task that each point belongs to.
    reach
        Distance of the farthest point from the base, m.
    """

    task: Task
    spec: DesignSpec
    settings: DesignSettings
    space: DesignSpace
    sets: FrozenSets
    goals: Goals
    owners: IntArray
    limits: Limits
    reach: float

    def guarded(self, share: float) -> tuple[Goals, Limits]:
        """Goals and limits with ``share`` of the settings' margins.

        The points of the problem come first, then those around each; the limits are narrower
        for moving joints only.
        """
        return (
            guarded_goals(self.task, self.goals, share * self.settings.margin * self.reach),
            _limits(self.spec, share * self.settings.limit_margin),
        )

    @property
    def goal_count(self) -> int:
        """Number of goals of the task."""
        return len(self.task.goals)

    def per_goal(self, penalties: Array) -> Array:
        """Sum the penalties of the problem's points (P or more,) by goal of the task, (G,)."""
        shares = np.zeros(self.goal_count)
        np.add.at(shares, self.owners, penalties[: len(self.owners)])
        return shares

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
        joints = tuple(
            Joint(f'joint_{i + 1}', lower, upper)
            for i, (lower, upper) in enumerate(self.spec.joint_limits.tolist())
        )
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
    task = with_balls(task, settings.ball)
    goals, owners = pack_task(task)
    reach = float(np.linalg.norm(goals.positions, axis=1).max())
    space = design_space(
        n,
        reach,
        bounds={**spec.bounds, **settings.bounds},
        fixed={**spec.fixed, **settings.fixed},
        alpha_step=settings.alpha_step or spec.alpha_step,
        family=settings.family or spec.family,
        max_length=min(settings.max_length, spec.max_length),
    )
    limits = _limits(spec, 0.0)
    sets = frozen_sets(limits, order, nodes)
    return DesignProblem(task, spec, settings, space, sets, goals, owners, limits, reach)


def _limits(spec: DesignSpec, margin: float) -> Limits:
    lower, upper = np.ascontiguousarray(spec.joint_limits.T)
    limited = upper - lower < FULL_TURN - 1e-6
    inset = np.where(limited, np.minimum(margin, 0.25 * (upper - lower)), 0.0)
    return Limits(lower + inset, upper - inset, limited, lower, upper)
