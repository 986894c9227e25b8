"""The first two steps of the demo: an arm for the task, and what it survives."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from typing import Any

from lifecycle_msgs.msg import Transition

from ft_manip_interfaces.msg import DesignCandidate, FtwsAnswer
from ft_manip_interfaces.srv import QueryFtws
from ft_manip_ros.core.arm_file import load_arm, save_dh
from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.goal import Task
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.conversions import dh_from_message, pose_to_message
from ft_manip_ros.nodes.demo_observer import START_TIME, Observer, StoryError
from ft_manip_ros.nodes.demo_options import arm_of
from ft_manip_ros.nodes.demo_processes import Processes
from ft_manip_ros.nodes.demo_timeline import Timeline

_FALLBACK = 'paredis_table_3'
# The point outside is looked for on the rays through the task's points, at these multiples.
_OUTWARDS = (1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0)


def start_designer(options: argparse.Namespace, processes: Processes) -> None:
    """Start the designer's process, unless an arm was given; it waits to be configured."""
    if options.arm:
        return
    parameters = {
        'task': options.task,
        'seed': options.seed,
        'time_budget': options.design_time,
        'autostart': False,
    }
    processes.start('designer', parameters)


def obtain_arm(
    options: argparse.Namespace, observer: Observer, processes: Processes, timeline: Timeline
) -> tuple[SerialChain, dict[str, Any]]:
    """Have the designer that was started design an arm, or take the one that was asked for.

    Returns
    -------
    chain
        The arm.
    parameters
        ``arm``, ``base`` and ``tip`` for the nodes.
    """
    if options.arm:
        chain = arm_of(options)
        timeline.line('demo', f'the arm is {chain.name}, {chain.n} joints, as asked')
        return chain, {'arm': options.arm, 'base': options.base, 'tip': options.tip}
    try:
        observer.transit('designer', Transition.TRANSITION_CONFIGURE, START_TIME)
        # It is quick: whoever wants to see candidates has to be there before it begins.
        observer.until_joined(topics.DESIGN_CANDIDATES, publishers=1, subscriptions=2)
        observer.until_joined(topics.DESIGN_FINAL, publishers=1, subscriptions=2)
        observer.transit('designer', Transition.TRANSITION_ACTIVATE, START_TIME)
        timeline.line('designer', f'searches for an arm for {options.task}, seed {options.seed}')
        final = observer.until(
            lambda: observer.final, options.design_time + 20.0, 'the design to be announced'
        )
    finally:
        # A task message would make it search again.
        processes.stop('designer')
    if final.status == DesignCandidate.FINAL_PROVED:
        table = dh_from_message(final.design)
        path = (options.output / 'designed_arm.yaml').resolve()
        save_dh(table, path)
        timeline.line(
            'designer',
            f'announces a proved {table.n}-joint design after {final.iteration} tables and '
            f'{len(observer.candidates)} accepted candidates: {final.reason}',
            good=True,
        )
        return load_arm(path), {'arm': str(path)}
    timeline.line(
        'designer',
        f'found NO provable design in {options.design_time:g} s ({final.reason}): going on with '
        f'{_FALLBACK} as printed',
    )
    return load_arm(_FALLBACK), {'arm': _FALLBACK}


def ask_workspace(
    chain: SerialChain, task: Task, must_hold: bool, observer: Observer, timeline: Timeline
) -> bool:
    """Ask the workspace node about the task's points and about points farther out.

    Parameters
    ----------
    must_hold
        The arm was made for the task: its points have to be members.

    Returns
    -------
    bool
        Whether every point of the task is a proved member.

    Raises
    ------
    StoryError
        Where the node contradicts the designer, or names no joint and angle for any point outside.
    """
    answers = _ask(observer, [goal.position for goal in task.goals])
    for goal, answer in zip(task.goals, answers, strict=True):
        timeline.line('workspace', f'{goal.id}: {in_words(answer)}', good=_good(answer, must_hold))
    members = all(answer.verdict == FtwsAnswer.MEMBER for answer in answers)
    if must_hold and not members:
        raise StoryError('the workspace node does not confirm that the points are fault tolerant')
    if any(answer.verdict == FtwsAnswer.NON_MEMBER and answer.joints for answer in answers):
        return members
    for factor in _OUTWARDS:
        for goal, answer in zip(
            task.goals, _ask(observer, [factor * g.position for g in task.goals]), strict=True
        ):
            if answer.verdict == FtwsAnswer.NON_MEMBER and answer.joints:
                name = f'{factor:g} x {goal.id}'
                timeline.line('workspace', f'{name}: {in_words(answer)}', good=True)
                return members
    raise StoryError('the workspace node names no joint and angle for any point outside')


def _ask(observer: Observer, points: Sequence[Array]) -> list[FtwsAnswer]:
    request = QueryFtws.Request(
        poses=[pose_to_message(point) for point in points], mode='position', time_budget=10.0
    )
    response = observer.call(QueryFtws, topics.QUERY_FTWS, request, timeout=60.0, again=25.0)
    if not response.success:
        raise StoryError(f'the workspace node refused the question: {response.message}')
    return list(response.answers)


def in_words(answer: FtwsAnswer) -> str:
    """Answer of the workspace node as one clause."""
    if answer.verdict == FtwsAnswer.MEMBER:
        around = f', so for {answer.margin * 1e3:.2g} mm around' * (answer.margin >= 1e-6)
        return f'member: any joint may lock at any angle (proved{around})'
    if answer.verdict == FtwsAnswer.UNDECIDED:
        return f'undecided: {answer.reason}'
    witness = ' and '.join(
        f'{name} locked at {math.degrees(angle):.1f} deg'
        for name, angle in zip(answer.joints, answer.angles, strict=True)
    )
    return f'not a member: with {witness} it is missed by {answer.residual * 1e3:.1f} mm or more'


def _good(answer: FtwsAnswer, must_hold: bool) -> bool | None:
    if answer.verdict == FtwsAnswer.MEMBER:
        return True
    return False if must_hold else None
