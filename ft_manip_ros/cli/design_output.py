"""What `ftmanip design` shows: the live line, the result as text and as JSON."""

from __future__ import annotations

from typing import Any

import numpy as np
from tqdm import tqdm

from ft_manip_ros.core.design.candidate import Candidate, DesignResult
from ft_manip_ros.core.design.settings import DesignSettings
from ft_manip_ros.core.goal import DesignSpec, Task


def to_json(
    task: Task, spec: DesignSpec, settings: DesignSettings, result: DesignResult
) -> dict[str, Any]:
    """Return the result as the command prints it with --json; lengths in m, angles in rad."""
    return {
        'task': task.name,
        'dof': spec.dof,
        'order': spec.order,
        'method': settings.method,
        'seed': settings.seed,
        'proved': result.proved,
        'reason': result.reason,
        'penalty': result.penalty,
        'goal_penalties': list(result.goal_penalties),
        'd': result.table.d.tolist(),
        'a': result.table.a.tolist(),
        'alpha': result.table.alpha.tolist(),
        'iterations': result.iterations,
        'evaluations': result.evaluations,
        'elapsed_s': result.elapsed,
        'verdicts': []
        if result.proof is None
        else [verdict.to_json() for verdict in result.proof.verdicts],
    }


def describe(result: DesignResult) -> str:
    """Return the result as a person reads it."""
    table = result.table
    head = 'PROVED' if result.proved else 'NOT PROVED'
    lines = [
        f'{head}: {result.reason}',
        f'{result.iterations} tables, {result.evaluations} penalty evaluations, '
        f'{result.elapsed:.2f} s; penalty {result.penalty:.3g}',
        'joint        d (m)      a (m)  alpha (deg)',
    ]
    alpha = np.rad2deg(table.alpha)
    lines += [
        f'{table.joints[i].name:<8} {table.d[i]:9.4f}  {table.a[i]:9.4f}  {alpha[i]:11.3f}'
        for i in range(table.n)
    ]
    if result.proof is not None:
        lines += [
            f'goal {v.point}: {v.verdict.value}, ball of {v.margin:.3g} m'
            for v in result.proof.verdicts
        ]
    return '\n'.join(lines)


class Progress:
    """A live line on standard error: tables tried, time, rate, penalties, temperature.

    Attributes
    ----------
    penalties
        Of every accepted candidate, in order.
    """

    def __init__(self, settings: DesignSettings) -> None:
        self.penalties: list[float] = []
        self._bar = tqdm(
            desc=f'{settings.method} seed {settings.seed}',
            unit=' tables',
            disable=None,
            mininterval=0.2,
            bar_format='{desc}: {n_fmt} tables, {elapsed}, {rate_fmt}{postfix}',
        )

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()

    def show(self, candidate: Candidate, best: Candidate) -> None:
        """Show the latest accepted candidate, and keep its penalty."""
        self.penalties.append(candidate.penalty)
        self._bar.update(max(candidate.iteration - self._bar.n, 0))
        self._bar.set_postfix_str(
            f'penalty {candidate.penalty:.3g}, best {best.penalty:.3g}, '
            f'T {candidate.temperature:.3g}, accepted {candidate.acceptance_rate:.0%}',
            refresh=False,
        )
