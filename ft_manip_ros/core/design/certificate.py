"""The certificate of an announced design: the FTWS engine's proofs, checked by its verifier."""

from __future__ import annotations

from typing import Any

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.ftws.certificate import certify, verify
from ft_manip_ros.core.goal import Goal, Task


def certify_design(chain: SerialChain, task: Task, order: int) -> list[dict[str, Any]]:
    """Proofs that every goal of ``task`` is a member, one document for each kind of goal.

    Positions, poses and poses with a free axis are different questions, so a task that mixes
    them needs up to three documents.
    """
    kinds: dict[tuple[bool, bool], list[Goal]] = {}
    for goal in task.goals:
        kinds.setdefault((goal.orientation is not None, goal.free_axis), []).append(goal)
    documents = []
    for (oriented, _), goals in sorted(kinds.items()):
        mode = 'pose' if oriented else 'position'
        documents.append(certify(chain, goals, order=order, mode=mode)[1])
    return documents


def check_certificates(documents: list[dict[str, Any]]) -> list[tuple[bool, str]]:
    """Verify every proof by the verifier that shares no code with the engine.

    Returns
    -------
    list of (confirmed, text)
        One entry a goal.
    """
    return [outcome for document in documents for outcome in verify(document)]
