"""What the search passes on: candidates, units of work, and the result."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from ft_manip_ros.core.chain import Array
from ft_manip_ros.core.design.proof import Proof
from ft_manip_ros.core.dh import DhTable

ShouldStop = Callable[[], bool]


@dataclass(frozen=True, eq=False)
class Candidate:
    """One table that the search accepted.

    Attributes
    ----------
    parameters : ndarray, shape (3n,)
        d, a, alpha (m, m, rad).
    penalty
        Equation 7, m^2 + rad^2.
    goal_penalties
        Its share for each goal of the task.
    temperature
        Of the annealing; 0 for methods without one.
    acceptance_rate
        Share of this chain's recent candidates that were accepted.
    iteration
        Tables tried so far, this one included.
    """

    parameters: Array
    penalty: float
    goal_penalties: tuple[float, ...]
    temperature: float
    acceptance_rate: float
    iteration: int


@dataclass(frozen=True, eq=False)
class Segment:
    """Outcome of one unit of work of one chain.

    Attributes
    ----------
    candidates
        Accepted, in order.
    winner, proof
        A table whose every goal is proved, with its proof; None where there is none yet.
    best_proof
        The most recent proof that failed, for the report.
    state
        What the chain's next unit starts from (numbers, strings, lists: fit for JSON); None for
        chains that start each unit afresh.
    tried, evaluations
        Tables tried, and penalty evaluations spent.
    complete
        False where time or a request to stop cut it short.
    """

    candidates: tuple[Candidate, ...]
    winner: Candidate | None
    proof: Proof | None
    best_proof: Proof | None
    state: Mapping[str, Any] | None
    tried: int
    evaluations: int
    complete: bool = True


@dataclass(frozen=True, eq=False)
class DesignResult:
    """Outcome of a design search.

    Attributes
    ----------
    table
        The best design found, proved or not.
    penalty
        Equation 7 for it, m^2 + rad^2.
    proved
        True where every goal is a proved member of its FTWS.
    proof
        Verdict of every goal for ``table``; None where it never came to a proof.
    iterations, evaluations
        Tables tried, and penalty evaluations spent.
    elapsed
        s.
    reason
        One sentence for a person.
    """

    table: DhTable
    penalty: float
    goal_penalties: tuple[float, ...]
    proved: bool
    proof: Proof | None
    iterations: int
    evaluations: int
    elapsed: float
    reason: str
