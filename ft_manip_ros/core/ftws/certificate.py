"""Certificates: the proof objects of verdicts as JSON, and their re-check."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.problem import Problem, goal_rows, prepare
from ft_manip_ros.core.ftws.query import judge_one
from ft_manip_ros.core.ftws.settings import FtwsSettings
from ft_manip_ros.core.ftws.verdict import FtwsResult, Verdict
from ft_manip_ros.core.ftws.verifier import NotConfirmedError, check_goal, check_region
from ft_manip_ros.core.ftws.verifier_arm import Arm
from ft_manip_ros.core.ftws.verifier_planar import PLANAR
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.core.whole_file import write_whole

FORMAT = 'ft_manip_ros/ftws-certificate/1'
# Room for the boxes of one goal: at first, and when several failures need millions.
_FIRST_PIECES = 20_000
_MOST_PIECES = 6_000_000


def certify(
    chain: SerialChain,
    goals: Sequence[Goal] | Array,
    *,
    order: int = 1,
    mode: str = 'position',
    settings: FtwsSettings | None = None,
) -> tuple[list[FtwsResult], dict[str, Any]]:
    """Judge goals and keep the proofs.

    Returns
    -------
    results : list of FtwsResult
    certificate : dict
        JSON-ready; see docs/ftws.md for the format.

    Raises
    ------
    InputError
        As `query.query`; also for mode ``'dextrous'``, whose evidence is not one proof, and for
        goals with and without a free tool axis in one certificate.
    """
    if mode == 'dextrous':
        raise InputError('mode', "'dextrous' has no certificate; valid are position, pose")
    settings = settings or FtwsSettings()
    rows, free = goal_rows(goals, mode)
    if len(set(free.tolist())) > 1:
        raise InputError('goals', 'mix free and fixed tool axes; certify them apart')
    problem = prepare(chain, mode, order, free_axis=bool(free.any()))
    results, entries = [], []
    for row in rows:
        result, pieces = _judge(problem, row, settings)
        results.append(result)
        entries.append(_entry(problem, row, result, pieces, settings.radius))
    document = {
        'format': FORMAT,
        'mode': mode,
        'tolerance': settings.tolerance,
        'orientation_tolerance': settings.orientation_tolerance,
        'arm': _arm_entry(problem),
        'goals': entries,
    }
    return results, document


def _judge(problem: Problem, row: Array, settings: FtwsSettings) -> tuple[FtwsResult, Array]:
    """Judge one goal and return the boxes of its proof, however many there are."""
    room = _FIRST_PIECES
    while True:
        pieces = np.zeros((room, 1 + problem.order + problem.chain.n))
        result = judge_one(problem, row, settings, pieces)
        used = pieces[np.abs(pieces[:, 1 : 1 + problem.order]).max(axis=1) > 0.0]
        if len(used) < room or room >= _MOST_PIECES:
            return result, used
        room = min(room * 17, _MOST_PIECES)


def _arm_entry(problem: Problem) -> dict[str, Any]:
    failing = set(problem.combos.ravel().tolist())
    return {
        'name': problem.chain.name,
        'joints': [
            {
                'name': joint.name,
                'prismatic': joint.prismatic,
                'lower': joint.lower,
                'upper': joint.upper,
                'operating': list(joint.operating),
                'fails': i in failing,
            }
            for i, joint in enumerate(problem.chain.joints)
        ],
        'rotations': problem.chain.rotations.tolist(),
        'translations': problem.chain.translations.tolist(),
    }


def _entry(
    problem: Problem, row: Array, result: FtwsResult, pieces: Array, radius: float
) -> dict[str, Any]:
    entry: dict[str, Any] = {
        'point': list(result.point),
        'order': problem.order,
        'verdict': result.verdict.value,
        'reason': result.reason,
        'radius': 0.0 if result.verdict is Verdict.UNDECIDED else radius,
    }
    if problem.oriented:
        entry['orientation'] = [*row[4:].tolist(), float(row[3])]
    if result.verdict is Verdict.NON_MEMBER:
        entry['joints'] = list(result.joints)
        entry['angles'] = list(result.angles)
        entry['residual'] = result.residual
    if result.closed_form and result.verdict is not Verdict.UNDECIDED:
        entry['kind'] = PLANAR
    if result.verdict is Verdict.MEMBER and result.closed_form:
        entry['slack'] = result.margin
    elif result.verdict is Verdict.MEMBER:
        k = problem.order
        entry['pieces'] = [
            {
                'joints': [problem.chain.joint_names[j] for j in problem.combos[int(piece[0])]],
                'half': piece[1 : 1 + k].tolist(),
                'posture': piece[1 + k :].tolist(),
            }
            for piece in pieces
        ]
    return entry


def save_certificate(document: Mapping[str, Any], path: str | os.PathLike[str]) -> None:
    """Write a certificate; the file appears whole or not at all."""
    write_whole(path, json.dumps(document))


def load_certificate(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read a certificate.

    Raises
    ------
    InputError
        For a file that is missing, not JSON or not a certificate.
    """
    try:
        document = json.loads(Path(path).read_text(encoding='utf-8'))
    except OSError as error:
        raise InputError(str(path), f'cannot be read: {error.strerror}') from None
    except ValueError as error:
        raise InputError(str(path), f'is not JSON: {error}') from None
    if not isinstance(document, dict) or document.get('format') != FORMAT:
        raise InputError(f'{path}: format', f'is not {FORMAT!r}')
    for key in ('mode', 'tolerance', 'orientation_tolerance', 'arm', 'goals'):
        if key not in document:
            raise InputError(f'{path}: {key}', 'is missing')
    return document


def verify(document: Mapping[str, Any]) -> Iterator[tuple[bool, str]]:
    """Check a certificate: goal by goal, then volume by volume.

    Yields
    ------
    confirmed : bool
    text : str
        What was confirmed, or what was not.

    Raises
    ------
    InputError
        For entries that are missing or malformed.
    """
    with _malformed('arm'):
        arm = Arm(
            document['arm'],
            document['mode'],
            float(document['tolerance']),
            float(document['orientation_tolerance']),
        )
    confirmed: list[bool] = []
    for i, goal in enumerate(document['goals']):
        with _malformed(f'goals[{i}]'):
            try:
                outcome = True, f'{goal["verdict"]}: {check_goal(arm, goal)}'
            except NotConfirmedError as rejection:
                outcome = False, f'{goal["verdict"]}: {rejection}'
        confirmed.append(outcome[0])
        yield outcome
    for i, region in enumerate(document.get('regions', ())):
        with _malformed(f'regions[{i}]'):
            claim = f'all of the {region["shape"]}'
            try:
                text = check_region(arm, region, document['goals'], confirmed)
                outcome = True, f'{claim}: {text}'
            except NotConfirmedError as rejection:
                outcome = False, f'{claim}: {rejection}'
        yield outcome


@contextmanager
def _malformed(entry: str) -> Iterator[None]:
    """Say which entry of a certificate cannot be read."""
    try:
        yield
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise InputError(f'certificate: {entry}', f'is malformed: {error!r}') from None
