"""The certificate of an announced design: the FTWS engine's proofs, checked by its verifier."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.design.proof import proof_settings
from ft_manip_ros.core.ftws.certificate import certify, verify
from ft_manip_ros.core.goal import Goal, Task

Document = dict[str, Any]
Outcome = tuple[bool, str]

# The verifier's mathematics is weaker than the engine's. Proofs that hold for a ball around the
# goal too (its radius a share of the goal's distance) have the slack that it needs, and another
# seed finds other postures: (share, seed) of the proofs tried until one is confirmed.
_TRIES = ((0.004, 0), (0.001, 0), (0.004, 1), (0.0, 0), (0.001, 1), (0.0, 1), (0.0, 2))
# Proofs for several failures at once take minutes, and so does checking them.
_TRIES_BEYOND_1 = ((0.001, 0), (0.0, 0))


def certify_design(
    chain: SerialChain, task: Task, order: int
) -> tuple[list[Document], list[Outcome]]:
    """Proofs that every goal of ``task`` is a member, and what the independent verifier says.

    Positions, poses and poses with a free axis are different questions, so a task that mixes
    them needs up to three documents.

    Returns
    -------
    documents : list of dict
        One for each kind of goal; see docs/ftws.md for the format.
    outcomes : list of (confirmed, text)
        One for each goal, in the order of the documents. A goal that is not confirmed is in its
        document all the same, with the last proof tried.
    """
    kinds: dict[tuple[bool, bool], list[Goal]] = {}
    for goal in task.goals:
        kinds.setdefault((goal.orientation is not None, goal.free_axis), []).append(goal)
    documents: list[Document] = []
    outcomes: list[Outcome] = []
    for _, goals in sorted(kinds.items()):
        answers = [_confirmed(chain, goal, order) for goal in goals]
        entries = [entry for document, _ in answers for entry in document['goals']]
        documents.append({**answers[0][0], 'goals': entries})
        outcomes += [
            (ok, f'{goal.id}: {text}' if goal.id else text)
            for goal, (_, (ok, text)) in zip(goals, answers, strict=True)
        ]
    return documents, outcomes


def _confirmed(chain: SerialChain, goal: Goal, order: int) -> tuple[Document, Outcome]:
    """Return the first proof of one goal that the verifier confirms, or the last one tried."""
    mode = 'position' if goal.orientation is None else 'pose'
    distance = float(np.linalg.norm(goal.position))
    tries = _TRIES if order == 1 else _TRIES_BEYOND_1
    for share, seed in tries:
        settings = replace(proof_settings(order, share * distance), seed=seed)
        document = certify(chain, [goal], order=order, mode=mode, settings=settings)[1]
        (outcome,) = verify(document)
        if document['goals'][0]['verdict'] != 'member':
            # The verifier has nothing against a claim of nothing, but that proves no design.
            outcome = (False, f'the engine does not prove it again: {outcome[1]}')
        if outcome[0]:
            break
    return document, outcome
