"""Node `demo`: the whole story as separate processes; exit code 1 if any of it did not happen."""

from __future__ import annotations

import argparse
import gc
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from lifecycle_msgs.msg import Transition
from rclpy.logging import LoggingSeverity
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import Task
from ft_manip_ros.core.task_file import load_task
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.demo_arm import ask_workspace, obtain_arm, start_designer
from ft_manip_ros.nodes.demo_bag import read_back, replay
from ft_manip_ros.nodes.demo_domain import own_domain
from ft_manip_ros.nodes.demo_observer import START_TIME, STOP_TIME, Observer, StoryError
from ft_manip_ros.nodes.demo_options import arm_of, chosen_joints, parse_options
from ft_manip_ros.nodes.demo_processes import Processes
from ft_manip_ros.nodes.demo_record import Record
from ft_manip_ros.nodes.demo_run import NotNeededError, execute, start_posture
from ft_manip_ros.nodes.demo_timeline import Timeline, table, tell_run

_ARM_NODES = ('arm_sim', 'fault_monitor', 'replanner')


class Story:
    """One demo: a design, then one run for each joint that is to lock."""

    def __init__(
        self,
        options: argparse.Namespace,
        observer: Observer,
        processes: Processes,
        timeline: Timeline,
    ) -> None:
        self.options = options
        self.observer = observer
        self.processes = processes
        self.timeline = timeline
        self.records: list[Record] = []
        self.problems: list[list[str]] = []
        observer.alarm = processes.dead

    def tell(self) -> bool:
        """Run everything; returns whether it all happened."""
        observer, options = self.observer, self.options
        # Both import at once; the designer designs when the recorder is there to record it.
        start_designer(options, self.processes)
        self._start_recorder(self._bag(0))
        observer.until(lambda: observer.active, 20.0, 'the demo node itself')
        task = load_task(options.task)
        observer.until_active('recorder', START_TIME)
        chain, parameters = obtain_arm(options, observer, self.processes, self.timeline)
        wanted = chosen_joints(options.joint, chain)
        fault_tolerant = False
        rng = np.random.default_rng(options.seed)
        for k, joint in enumerate(wanted or ['']):
            if len(wanted) > 1:
                self.timeline.heading(f'{joint} (run {k + 1} of {len(wanted)})')
            start = start_posture(chain, rng)
            self._start_arm(parameters, start, first=k == 0)
            if k == 0:
                fault_tolerant = ask_workspace(
                    chain, task, not options.arm, observer, self.timeline
                )
            else:
                self._start_recorder(self._bag(k))
                observer.until_active('recorder', START_TIME)
            self._until_joined()
            joints = [joint] if joint else list(chain.joint_names)
            self._run(k, chain, task, joints, fault_tolerant, rng)
        return self._conclude()

    def _bag(self, k: int) -> Path:
        return Path(self.options.output) / ('bag' if k == 0 else f'bag_{k + 1}')

    def _start_recorder(self, bag: Path) -> None:
        self.processes.start('recorder', {'output': str(bag), 'seed': self.options.seed})

    def _start_arm(self, parameters: dict[str, Any], start: Any, *, first: bool) -> None:
        own = {'arm_sim': {'start': start.tolist(), 'seed': self.options.seed}}
        names = (*_ARM_NODES, 'workspace') if first else _ARM_NODES
        for node in names:
            self.processes.start(node, {**parameters, **own.get(node, {})})
        for node in names:
            self.observer.until_active(node, START_TIME)

    def _until_joined(self) -> None:
        """Wait until everybody hears everybody; the recorder included."""
        observer = self.observer
        for topic, speakers, listeners in (
            (topics.JOINT_STATES, 1, 4),
            (topics.JOINT_TRAJECTORY, 1, 4),
            (topics.TASK, 1, 2),
            (topics.FAULT_STATE, 1, 3),
            (topics.FAULT_EVENTS, 1, 1),
            (topics.RECOVERY_PLAN, 1, 2),
        ):
            observer.until_joined(topic, publishers=speakers, subscriptions=listeners)
        observer.until(lambda: observer.states, 20.0, 'joint states')

    def _run(
        self,
        k: int,
        chain: SerialChain,
        task: Task,
        joints: list[str],
        fault_tolerant: bool,
        rng: np.random.Generator,
    ) -> None:
        observer, timeline = self.observer, self.timeline
        try:
            record = execute(chain, task, joints, fault_tolerant, rng, observer, timeline)
            # The bag is read next: whole, however long the disk takes.
            observer.transit('recorder', Transition.TRANSITION_DEACTIVATE, STOP_TIME)
        except NotNeededError as error:
            if self.options.joint != 'all':
                raise
            timeline.line('demo', f'no failure to show: {error}')
            return
        finally:
            self.processes.stop('recorder', *_ARM_NODES)
            observer.forget()
            observer.withdraw_task()
        problems = record.problems()
        tell_run(timeline, record)
        # Not before: matplotlib and the compiler would keep the story from beginning.
        from ft_manip_ros.nodes.demo_picture import draw

        picture = Path(self.options.output) / ('demo.png' if k == 0 else f'demo_{k + 1}.png')
        draw(record, picture)
        timeline.line('demo', f'picture: {picture}', good=True)
        try:
            read_back(self._bag(k), record, k == 0, timeline)
            replay(self._bag(k), timeline)
        except StoryError as error:
            timeline.line('demo', str(error), good=False)
            problems.append(str(error))
        self.records.append(record)
        self.problems.append(problems)

    def _conclude(self) -> bool:
        if len(self.records) > 1:
            self.timeline.heading('All runs')
            print(table(self.records, self.problems))
        for record, problems in zip(self.records, self.problems, strict=True):
            for problem in problems:
                self.timeline.line('demo', f'{record.joint}: {problem}', good=False)
        happened = bool(self.records) and not any(self.problems)
        if happened:
            self.timeline.line('demo', 'everything happened as told above', good=True)
        return happened


def main(args: Sequence[str] | None = None) -> int:
    """Tell the story; returns 0 if all of it happened, 1 if not, 2 for bad options."""
    arguments = list(sys.argv if args is None else args)
    options = parse_options(remove_ros_args(arguments)[1:])
    timeline = Timeline()
    try:
        # What can be wrong with the options is said before anything starts.
        load_task(options.task)
        if options.arm:
            chosen_joints(options.joint, arm_of(options))
        options.output.mkdir(parents=True, exist_ok=True)
        if any(options.output.glob('bag*')):
            raise InputError(
                '--output', f'{options.output} has a bag already; take another folder'
            )
    except (InputError, OSError) as error:
        print(f'demo: {error}', file=sys.stderr)
        return 2
    # SIGINT too: it is ignored in what a shell starts in the background.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)
    with own_domain(options.domain) as domain:
        timeline.line('demo', f'ROS_DOMAIN_ID={domain}, seed {options.seed}, {options.output}')
        happened = False
        try:
            happened = _tell(options, arguments, timeline)
        except (StoryError, InputError, subprocess.TimeoutExpired) as error:
            timeline.line('demo', f'{error}', good=False)
            print(f'the logs of all processes are in {options.output / "logs"}', file=sys.stderr)
        except KeyboardInterrupt:
            print('stopped; no process is left', file=sys.stderr, flush=True)
            # As in `process.run`: whoever stops the demo does not want to wait for its libraries.
            gc.collect()
            sys.stdout.flush()
            os._exit(130)
    if happened and not options.headless:
        _show(options.output / 'demo.png')
    return 0 if happened else 1


def _tell(options: argparse.Namespace, arguments: list[str], timeline: Timeline) -> bool:
    # Its own signal handlers would end the ROS context before the processes are stopped.
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    try:
        with Processes(options.output / 'logs') as processes:
            observer = Observer()
            # Its own life cycle is not part of the story.
            observer.get_logger().set_level(LoggingSeverity.WARN)
            try:
                return Story(options, observer, processes, timeline).tell()
            finally:
                observer.close()
    finally:
        rclpy.try_shutdown()


def _interrupt(*_: Any) -> None:
    raise KeyboardInterrupt


def _show(picture: Path) -> None:
    """Open the picture where there is a screen."""
    opener = shutil.which('xdg-open')
    if opener and (os.environ.get('DISPLAY') or os.environ.get('WAYLAND_DISPLAY')):
        subprocess.Popen([opener, str(picture)], start_new_session=True)


if __name__ == '__main__':
    sys.exit(main())
