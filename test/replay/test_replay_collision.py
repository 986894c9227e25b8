"""A bag recorded with collision checking replays to the same plans, or says why it cannot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from builtin_interfaces.msg import Duration
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from ft_manip_interfaces.msg import FaultState, RecoveryPlan
from ft_manip_ros.bags.definitions import message_definition
from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.bags.replay import replay
from ft_manip_ros.bags.writer import BagWriter
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.config_files import find_config
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.goal import Goal, Task
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.planning.collision_setup import CollisionOptions, make_checker
from ft_manip_ros.core.planning.executive import Executive
from ft_manip_ros.nodes.conversions import nanoseconds, stamp, task_to_message
from ft_manip_ros.nodes.plan_messages import plan_to_message
from support.cdr import cdr, type_name_of

ARM = 'paredis_table_3'
FROZEN = 'joint_5'
START = np.array([0.4, -0.6, 0.8, 0.3, 0.2])
SECOND = 1_000_000_000


@pytest.fixture(scope='module')
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """What an arm at rest with a ball in its way recorded, and a function that writes the bag."""
    folder = tmp_path_factory.mktemp('recorded')
    chain = load_arm(ARM)
    end = START + np.array([1.6, 0.4, -0.5, 0.4, 0.0])
    # In the middle of the straight way.
    middle = fk(chain, 0.5 * (START + end))[1].tolist()
    obstacles = folder / 'around.yaml'
    obstacles.write_text(yaml.safe_dump({'obstacles': [{'sphere': 0.15, 'position': middle}]}))
    options = CollisionOptions(link_radius=0.03, obstacles=str(obstacles))
    checker = make_checker(chain, ARM, None, options)
    assert not checker.touches(START) and checker.move_touches(START, end)
    executive = Executive(chain, checker=checker)
    task = Task('around', (Goal(fk(chain, end)[1], id='behind the ball'),))
    messages: list[tuple[str, Any, int]] = []

    def note(decision: Any, topic: str, now: int) -> RecoveryPlan:
        report = plan_to_message(
            decision.plan, task.name, Header(stamp=stamp(now)), decision.stamp
        )
        messages.append((topic, report, now))
        return report

    for k in range(60):
        now = SECOND + k * SECOND // 100
        state = JointState(name=list(chain.joint_names), position=START.tolist())
        state.header.stamp = stamp(now)
        messages.append(('/joint_states', state, now))
        executive.on_joint_state(now, dict(zip(chain.joint_names, START.tolist(), strict=True)))
        if k == 20:
            messages.append(('/task', task_to_message(task, now, 'base'), now))
            note(executive.on_task(task), '/replanner/task_plan', now)
        if k == 40:
            fault = FaultState(frozen_joints=[FROZEN], frozen_positions=[START[4]])
            fault.header.stamp = stamp(now)
            messages.append(('/fault_state', fault, now))
            report = note(
                executive.on_fault_state(now, {FROZEN: START[4]}, {}), '/recovery_plan', now
            )
            # Planning took its time, in which the arm rested.
            report.pause = 0.5
            for goal in report.goals:
                goal.arrival += 0.5
            for point in report.trajectory.points[1:]:
                later = nanoseconds(point.time_from_start) + SECOND // 2
                point.time_from_start = Duration(sec=later // SECOND, nanosec=later % SECOND)

    def write(name: str, parameters: dict[str, Any], *attached: str) -> Any:
        with BagWriter(folder / name) as writer:
            given = {'arm': ARM, 'collision': True, 'link_radius': 0.03, **parameters}
            # The monitor of the same graph, whose joints these are too.
            writer.add_provenance('parameters/fault_monitor', {'arm': ARM})
            writer.add_provenance(
                'parameters/replanner', {k: yaml.safe_dump(v) for k, v in given.items()}
            )
            if 'arm' in attached:
                writer.add_attachment(
                    'arm/replanner.yaml', 'application/yaml', find_config('arms', ARM).read_bytes()
                )
            if 'obstacles' in attached:
                writer.add_attachment(
                    'obstacles/replanner.yaml', 'application/yaml', obstacles.read_bytes()
                )
            for topic, message, now in messages:
                key = writer.add_topic(topic, message_definition(type_name_of(message)))
                writer.write(key, cdr(message), now, now)
        return open_bag(folder / name)

    return write, obstacles


def test_the_same_plans_come_from_what_the_bag_keeps(recorded: Any) -> None:
    write, _ = recorded
    # The parameter names a file of another machine.
    bag = write('whole', {'obstacles': '/elsewhere/around.yaml'}, 'arm', 'obstacles')
    result = replay(bag, exact=True)
    assert len(result.recorded) == len(result.replayed) == 2
    assert result.differences == ()
    assert not [note for note in result.notes if 'obstacles' in note]
    # Without the ball the arm goes straight, which takes less time.
    different = replay(bag, overrides={'replanner.collision': False}).differences
    assert {field for d in different for field in d.fields} >= {'duration'}


def test_a_file_that_is_not_in_the_bag_is_named(recorded: Any) -> None:
    write, obstacles = recorded
    here = replay(write('outside', {'obstacles': str(obstacles)}, 'arm'))
    assert here.differences == ()
    assert f'the obstacles of replanner are not in the bag: {obstacles} is used' in here.notes
    gone = replay(write('gone', {'obstacles': '/elsewhere/around.yaml'}, 'arm'), exact=True)
    assert any('neither in the bag nor here: left out' in note for note in gone.notes)
    assert gone.differences


def test_bodies_that_cannot_be_had_are_an_error_and_say_what_helps(recorded: Any) -> None:
    write, _ = recorded
    bag = write('bodiless', {'link_radius': 0.0}, 'arm')
    with pytest.raises(
        InputError, match=r'recorded with collision checking.*replanner\.collision'
    ):
        replay(bag)
    assert len(replay(bag, overrides={'replanner.collision': False}).replayed) == 2


def test_the_recorder_keeps_the_files_that_parameters_name(tmp_path: Path) -> None:
    from ft_manip_ros.nodes.parameter_capture import ParameterCapture

    around, disabled = tmp_path / 'a.yaml', tmp_path / 'b.srdf'
    around.write_text('obstacles: []')
    disabled.write_text('<robot/>')
    kept: dict[str, bytes] = {}

    def keep(name: str, kind: str, data: bytes) -> None:
        kept[name] = data

    capture = ParameterCapture(None, lambda name: True, lambda *_: None, keep)
    capture._on_values(
        '/replanner', {'arm': ARM, 'obstacles': str(around), 'srdf': str(disabled), 'seed': 3}
    )
    assert kept == {
        'arm/replanner.yaml': find_config('arms', ARM).read_bytes(),
        'obstacles/replanner.yaml': b'obstacles: []',
        'srdf/replanner.srdf': b'<robot/>',
    }
    capture._on_values('/replanner', {'obstacles': '', 'srdf': '/gone.srdf'})
    assert len(kept) == 3
