"""The last step of the demo: the bag is read back by others, and replayed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from rosbags.rosbag2 import ReaderError

from ft_manip_ros.bags.independent_readers import count_with_mcap, count_with_rosbags
from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.demo_observer import StoryError
from ft_manip_ros.nodes.demo_record import Record
from ft_manip_ros.nodes.demo_timeline import Timeline


def read_back(bag: Path, record: Record, queried: bool, timeline: Timeline) -> None:
    """Read the bag with the mcap library and with rosbags; both must find the whole story.

    Parameters
    ----------
    queried
        The workspace node was asked while this bag was recorded.

    Raises
    ------
    StoryError
        Where they disagree or something is missing.
    """
    try:
        counts, again = count_with_rosbags(bag), count_with_mcap(bag)
    except (OSError, ReaderError) as error:
        raise StoryError(f'{bag} is not whole: {error}') from error
    if counts != again:
        raise StoryError(f'rosbags and mcap read different bags: {counts} and {again}')
    wanted = [
        topics.JOINT_STATES,
        topics.JOINT_TRAJECTORY,
        topics.TASK,
        topics.FAULT_STATE,
        topics.FAULT_EVENTS,
        topics.RECOVERY_PLAN,
        topics.service_events(topics.INJECT_FAULT),
    ] + [topics.service_events(topics.QUERY_FTWS)] * queried
    missing = [name for name in wanted if not counts['/' + name]]
    if missing:
        raise StoryError(f'the bag has no messages of {", ".join(missing)}')
    content = open_bag(bag)
    states, queries = '/' + topics.FAULT_STATE, '/' + topics.service_events(topics.QUERY_FTWS)
    found = [(m.topic, content.decode(m)) for m in content.messages({states, queries})]
    if not any(record.joint in m.frozen_joints for topic, m in found if topic == states):
        raise StoryError(f'no fault state in the bag names {record.joint}')
    verdicts = sum(
        len(answer.answers) for topic, m in found if topic == queries for answer in m.response
    )
    if queried and not verdicts:
        raise StoryError('the bag has no FTWS verdicts')
    text = f'{bag}: {sum(counts.values())} messages on {len(counts)} topics, the fault'
    text += f' and {verdicts} FTWS verdicts' if queried else ''
    timeline.line('recorder', f'{text} in it, read back by rosbags and by mcap', good=True)


def replay(bag: Path, timeline: Timeline) -> None:
    """Run ``ftmanip replay --check`` on the bag.

    Raises
    ------
    StoryError
        If anything comes out differently.
    """
    command = [sys.executable, '-m', 'ft_manip_ros.cli.main', 'replay', str(bag), '--check']
    done = subprocess.run(command, capture_output=True, text=True, timeout=120.0, check=False)
    lines = done.stdout.strip().splitlines()
    if done.returncode != 0:
        first = next((i for i, line in enumerate(lines) if line.startswith('Differences')), 0)
        told = '\n'.join([*lines[first : first + 8], *done.stderr.strip().splitlines()[-3:]])
        raise StoryError(f'the replay does not reproduce the run:\n{told}')
    summary = next((line for line in lines if 'differences' in line), 'reproduced')
    timeline.line('replay', f'the same cores, fed from the bag: {summary}', good=True)
