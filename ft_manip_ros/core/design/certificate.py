"""The certificate of an announced design: the FTWS engine's proofs, checked by its verifier."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.design.proof import MOST_CELLS, proof_settings
from ft_manip_ros.core.ftws.certificate import certify, save_certificate, verify
from ft_manip_ros.core.goal import Goal, Task
from ft_manip_ros.core.region import Region, Sphere

Document = dict[str, Any]
Outcome = tuple[bool, str]

# Proofs that hold for a ball around the goal too (its radius a share of the goal's distance) have
# slack for the verifier, and another seed finds other postures: (share, seed) of the proofs tried
# until one is confirmed.
_TRIES = ((0.004, 0), (0.001, 0), (0.004, 1), (0.0, 0), (0.001, 1), (0.0, 1), (0.0, 2))
# Proofs for several failures at once are long, and so is checking them.
_TRIES_BEYOND_1 = ((0.0, 0), (0.0, 1))
# A volume's cells are cut down to this share of its size.
_FINEST = 1.0 / 64.0


def never() -> bool:
    """Return False: nobody asks to stop."""
    return False


def certify_design(
    chain: SerialChain, task: Task, order: int, should_stop: Callable[[], bool] = never
) -> tuple[list[Document], list[Outcome]]:
    """Proofs that every goal of ``task`` is a member, and what the independent verifier says.

    Positions, poses and poses with a free axis are different questions, so a task that mixes
    them needs up to three documents.

    Parameters
    ----------
    should_stop
        Polled between two proofs; what is then left is not confirmed.

    Returns
    -------
    documents : list of dict
        One for each kind of goal; see docs/ftws.md for the format.
    outcomes : list of (confirmed, text)
        One for each goal, in the order of the documents: of a goal with a region, for all of
        it. A goal that is not confirmed is in its document all the same, with the last proof
        tried.
    """
    kinds: dict[tuple[bool, bool], list[Goal]] = {}
    for goal in task.goals:
        kinds.setdefault((goal.orientation is not None, goal.free_axis), []).append(goal)
    documents: list[Document] = []
    outcomes: list[Outcome] = []
    for _, goals in sorted(kinds.items()):
        entries: list[Document] = []
        regions: list[Document] = []
        for goal in goals:
            if should_stop():
                outcome = (False, 'stopped before it was proved again')
            else:
                document, outcome = _confirmed(chain, goal, order)
                entries += document['goals']
                if goal.region is not None and outcome[0]:
                    region, outcome = _confirmed_region(
                        chain, goal, goal.region, order, entries, should_stop
                    )
                    regions.append(region)
            outcomes.append((outcome[0], f'{goal.id}: {outcome[1]}' if goal.id else outcome[1]))
        if entries:
            documents.append({**document, 'goals': entries, 'regions': regions})
    return documents, outcomes


def write_certificate(
    path: str | os.PathLike[str],
    chain: SerialChain,
    task: Task,
    order: int,
    should_stop: Callable[[], bool] = never,
) -> list[Outcome]:
    """Write the documents of `certify_design`, each whole: the second to ``path.2``, and so on.

    Returns
    -------
    list of (confirmed, text)
        What the verifier says of each goal.

    Raises
    ------
    InputError
        Where a file cannot be written.
    """
    documents, outcomes = certify_design(chain, task, order, should_stop)
    for i, document in enumerate(documents):
        save_certificate(document, path if i == 0 else f'{os.fspath(path)}.{i + 1}')
    return outcomes


def opinion(outcomes: Sequence[Outcome]) -> str:
    """What the verifier says of all goals, in one sentence for a person."""
    rejected = [text for confirmed, text in outcomes if not confirmed]
    if not rejected:
        return f'the independent verifier confirms all {len(outcomes)} goals'
    return f'the independent verifier does not confirm {len(rejected)} goals: {rejected[0]}'


def _prove_and_verify(
    chain: SerialChain, goal: Goal, order: int, radius: float, seed: int = 0
) -> tuple[Document, Outcome]:
    """Prove one goal with the ball around it, and ask the verifier."""
    mode = 'position' if goal.orientation is None else 'pose'
    settings = replace(proof_settings(order, radius), seed=seed)
    document = certify(chain, [goal], order=order, mode=mode, settings=settings)[1]
    if document['goals'][0]['verdict'] != 'member':
        # The verifier has nothing against a claim of nothing, but that proves no design.
        reason = document['goals'][0]['reason']
        return document, (False, f'the engine does not prove it again: {reason}')
    (outcome,) = verify(document)
    return document, outcome


def _confirmed(chain: SerialChain, goal: Goal, order: int) -> tuple[Document, Outcome]:
    """Return the first proof of one goal that the verifier confirms, or the last one tried."""
    distance = float(np.linalg.norm(goal.position))
    for share, seed in _TRIES if order == 1 else _TRIES_BEYOND_1:
        document, outcome = _prove_and_verify(chain, goal, order, share * distance, seed)
        if outcome[0]:
            break
    return document, outcome


def _confirmed_region(
    chain: SerialChain,
    goal: Goal,
    region: Region,
    order: int,
    entries: list[Document],
    should_stop: Callable[[], bool],
) -> tuple[Document, Outcome]:
    """Cover a region by boxes, each inside a ball that the verifier confirms.

    A box that is not confirmed is halved across its longest edge.

    Parameters
    ----------
    entries
        The document's goals; the balls are added to them.

    Returns
    -------
    region, outcome
        The document's entry, and whether all of the region is confirmed.
    """
    half = region.half
    finest = _FINEST * float(half.max())
    cells: list[Document] = []
    stack: list[tuple[Array, Array]] = [(np.zeros(3), half)]
    failed = ''
    while stack:
        at, half = stack.pop()
        if region.nearest(at, half) is None:
            continue
        center = goal.position + at
        radius = float(np.linalg.norm(half)) * (1.0 + 1e-9)
        ball = replace(goal, position=center, region=None)
        document, (ok, text) = _prove_and_verify(chain, ball, order, radius)
        if ok:
            cells.append({'center': center.tolist(), 'half': half.tolist(), 'goal': len(entries)})
            entries += document['goals']
            continue
        longest = int(np.argmax(half))
        if half[longest] <= finest or len(cells) >= MOST_CELLS or should_stop():
            where = ', '.join(f'{x:.4g}' for x in center)
            failed = f'the {region} is not confirmed near ({where}): {text}'
            break
        shift = np.zeros(3)
        shift[longest] = 0.5 * half[longest]
        stack += [(at - shift, half - shift), (at + shift, half - shift)]
    entry: Document = {
        'center': goal.position.tolist(),
        'order': order,
        'cells': cells,
        **(
            {'shape': 'sphere', 'radius': region.radius}
            if isinstance(region, Sphere)
            else {'shape': 'box', 'half': region.half.tolist()}
        ),
    }
    if 'orientation' in entries[-1]:
        entry['orientation'] = entries[-1]['orientation']
    return entry, (not failed, failed or f'the {region} is covered by {len(cells)} balls')
