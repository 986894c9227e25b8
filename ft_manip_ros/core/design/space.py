"""The space of DH tables searched: ranges, fixed values, steps of alpha, tied links, length."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.errors import InputError

if TYPE_CHECKING:
    from ft_manip_ros.core.design.dh_kernels import IntArray

COLUMNS = ('d', 'a', 'alpha')
FAMILIES = ('free', 'symmetric')
# Default ranges of d and a, as a share of the farthest goal's distance from the base.
REACH_SHARE = 1.35


@dataclass(frozen=True, eq=False)
class DesignSpace:
    """Box of DH parameters in the order d_1..d_n, a_1..a_n, alpha_1..alpha_n.

    Attributes
    ----------
    lower, upper : ndarray, shape (3n,)
        m, m, rad; equal where a parameter is fixed. alpha_n is always fixed at zero: it only
        turns the tool, which leaves the paper's 3n-1 parameters.
    group : ndarray, shape (3n,)
        Variable that each parameter follows, -1 where it is fixed. Tied parameters share one.
    alpha_step
        alpha may only be a multiple of this (rad); 0 for any value.
    max_length
        Largest allowed sum of sqrt(a_i^2 + d_i^2) (m).
    """

    lower: Array
    upper: Array
    group: IntArray
    alpha_step: float = 0.0
    max_length: float = np.inf

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.lower) // 3

    @property
    def size(self) -> int:
        """Number of variables."""
        return int(self.group.max()) + 1 if len(self.group) else 0

    @property
    def span(self) -> Array:
        """Range of every parameter, shape (3n,)."""
        return self.upper - self.lower

    def sample(self, rng: np.random.Generator) -> Array:
        """Return a random admissible table, shape (3n,)."""
        shares = rng.random(self.size)
        return self.project(np.where(self.group < 0, self.lower, self._spread(shares)))

    def project(self, p: Array) -> Array:
        """Return the admissible table near ``p``: ties, steps, ranges, then total length."""
        out = np.clip(p, self.lower, self.upper)
        n = self.n
        if self.alpha_step > 0.0:
            at = np.flatnonzero(self.group[2 * n :] >= 0) + 2 * n
            lowest = np.ceil(self.lower[at] / self.alpha_step - 1e-9)
            highest = np.floor(self.upper[at] / self.alpha_step + 1e-9)
            steps = np.clip(np.round(out[at] / self.alpha_step), lowest, highest)
            out[at] = steps * self.alpha_step
        length = self.length(out)
        if length > self.max_length:
            free = self.group[: 2 * n] >= 0
            out[: 2 * n][free] *= self.max_length / length
            out = np.clip(out, self.lower, self.upper)
        return out

    def length(self, p: Array) -> float:
        """Sum of the links' lengths sqrt(a_i^2 + d_i^2), m."""
        n = self.n
        return float(np.hypot(p[:n], p[n : 2 * n]).sum())

    def admits(self, p: Array) -> bool:
        """Return True where ``p`` keeps every bound (to rounding)."""
        return bool(
            np.allclose(self.project(p), p, atol=1e-9)
            and self.length(p) <= self.max_length * (1.0 + 1e-9)
        )

    def neighbour(self, p: Array, spread: float, rng: np.random.Generator) -> Array:
        """Return a table near ``p``: one to three variables moved by about ``spread`` spans."""
        chosen = rng.choice(self.size, size=int(rng.integers(1, min(3, self.size) + 1)))
        moves = np.zeros(self.size)
        moves[chosen] = rng.normal(size=len(chosen)) * spread
        out = p + np.where(self.group < 0, 0.0, self._pick(moves)) * self.span
        # Reflected, not clipped: clipping would pile the candidates up on the bounds.
        out = np.where(out > self.upper, 2.0 * self.upper - out, out)
        out = np.where(out < self.lower, 2.0 * self.lower - out, out)
        if self.alpha_step > 0.0:
            for variable in chosen:
                tied = np.flatnonzero(self.group == variable)
                tied = tied[tied >= 2 * self.n]
                out[tied] = p[tied] + self.alpha_step * rng.choice([-2, -1, 1, 2])
        return self.project(out)

    def movable(self, p: Array, gradient: Array) -> IntArray:
        """Variables along which a descent from ``p`` can move.

        Left out are those that come in steps, and those at a bound that ``gradient`` (size,)
        pushes against.
        """
        moving = np.ones(self.size, dtype=bool)
        for i in np.flatnonzero(self.group >= 0):
            slope = gradient[self.group[i]]
            stepped = self.alpha_step > 0.0 and i >= 2 * self.n
            outward = (p[i] <= self.lower[i] and slope > 0.0) or (
                p[i] >= self.upper[i] and slope < 0.0
            )
            if stepped or outward:
                moving[self.group[i]] = False
        return np.flatnonzero(moving)

    def to_variables(self, gradients: Array) -> Array:
        """Rows of d/dp, shape (C, 3n), as rows of d/dvariable scaled by the spans, (C, size)."""
        out = np.zeros((len(gradients), self.size))
        for column in np.flatnonzero(self.group >= 0):
            out[:, self.group[column]] += gradients[:, column] * self.span[column]
        return out

    def moved(self, p: Array, step: Array) -> Array:
        """Return ``p`` moved by ``step`` (size,) spans, made admissible."""
        return self.project(p + np.where(self.group < 0, 0.0, self._pick(step)) * self.span)

    def _pick(self, values: Array) -> Array:
        return values[np.maximum(self.group, 0)]

    def _spread(self, shares: Array) -> Array:
        return self.lower + self._pick(shares) * self.span


def design_space(
    dof: int,
    reach: float,
    *,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    fixed: Mapping[str, float] | None = None,
    alpha_step: float = 0.0,
    family: str = 'free',
    max_length: float = np.inf,
) -> DesignSpace:
    """Return the space of tables for ``dof`` joints.

    Parameters
    ----------
    reach
        Distance of the farthest goal from the base (m); sets the default ranges of d and a.
    bounds
        Ranges by column (``'d'``, ``'a'``, ``'alpha'``) or by parameter (``'a_3'``).
    fixed
        Values by parameter, e.g. ``{'alpha_2': 0.0}`` (m or rad).
    family
        ``'symmetric'`` ties a_i to a_(n+1-i), d_i to d_(n+1-i) and alpha_i to alpha_(n-i).

    Raises
    ------
    InputError
        For an unknown parameter, an empty range, a space without a free parameter.
    """
    size = REACH_SHARE * max(reach, 1e-3)
    default = {'d': (-size, size), 'a': (0.0, size), 'alpha': (-np.pi, np.pi)}
    lower, upper = np.empty(3 * dof), np.empty(3 * dof)
    for k, column in enumerate(COLUMNS):
        lo, hi = default[column]
        lower[k * dof : (k + 1) * dof] = lo
        upper[k * dof : (k + 1) * dof] = hi
    by_column = {k: v for k, v in (bounds or {}).items() if k in COLUMNS}
    for name, (lo, hi) in {**by_column, **(bounds or {})}.items():
        at = _places(name, dof)
        if not (np.isfinite(lo) and np.isfinite(hi) and lo <= hi):
            raise InputError(f'bounds.{name}', f'[{lo:g}, {hi:g}] is not an interval')
        lower[at], upper[at] = lo, hi
    for name, value in (fixed or {}).items():
        if not np.isfinite(value):
            raise InputError(f'fixed.{name}', f'is {value}; must be finite')
        lower[_places(name, dof)] = upper[_places(name, dof)] = value
    lower[-1] = upper[-1] = 0.0
    if not (np.isfinite(alpha_step) and 0.0 <= alpha_step <= np.pi):
        raise InputError('alpha_step', f'is {alpha_step}; must be between 0 and pi rad')
    if not max_length > 0.0:
        raise InputError('max_length', f'is {max_length}; must be > 0 m')
    group = _groups(lower, upper, dof, family)
    if group.max() < 0:
        raise InputError('bounds', 'fix every DH parameter; the search needs at least one free')
    return DesignSpace(lower, upper, group, alpha_step, max_length)


def _places(name: str, dof: int) -> Sequence[int]:
    column, _, number = name.partition('_')
    if column in COLUMNS:
        first = COLUMNS.index(column) * dof
        if not number and name in COLUMNS:
            return range(first, first + dof)
        if number.isdigit() and 1 <= int(number) <= dof:
            return [first + int(number) - 1]
    raise InputError(
        f'DH parameter {name!r}', f'is unknown; use d, a, alpha or d_1 ... alpha_{dof}'
    )


def _groups(lower: Array, upper: Array, dof: int, family: str) -> IntArray:
    if family not in FAMILIES:
        raise InputError('family', f'is {family!r}; must be one of {", ".join(FAMILIES)}')
    leader = np.arange(3 * dof)
    if family == 'symmetric':
        for i in range(dof):
            leader[i] = min(i, dof - 1 - i)
            leader[dof + i] = dof + min(i, dof - 1 - i)
            if i < dof - 1:
                leader[2 * dof + i] = 2 * dof + min(i, dof - 2 - i)
    group = np.full(3 * dof, -1, dtype=np.int64)
    numbers: dict[int, int] = {}
    for i in range(3 * dof):
        if upper[i] > lower[i]:
            at = int(leader[i])
            if (lower[i], upper[i]) != (lower[at], upper[at]):
                raise InputError('family', 'symmetric links need the same bounds')
            group[i] = numbers.setdefault(at, len(numbers))
    return group
