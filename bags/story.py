"""Recording one case: the real nodes as processes, and an arm that fails as the case says."""

from __future__ import annotations

from collections import deque
from pathlib import Path

import numpy as np
import rclpy
from cases import Case
from rclpy.node import Node
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from ft_manip_interfaces.srv import ClearFault, FreezeJoint, InjectFault, QueryFtws
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import Array, SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.sim import SimSettings, SimulatedArm
from ft_manip_ros.core.task_file import load_task
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.conversions import (
    nanoseconds,
    path_from_message,
    pose_to_message,
    seconds,
    task_to_message,
)
from ft_manip_ros.nodes.demo_domain import own_domain
from ft_manip_ros.nodes.demo_observer import Observer
from ft_manip_ros.nodes.demo_processes import Processes
from ft_manip_ros.nodes.recorder_parameters import TOPICS

HERE = Path(__file__).resolve().parent
_SECOND = 1_000_000_000
_PERIOD = 0.01  # s, between joint states
_SPELL = 1.0  # s, that a corruption lasts
_DRIFT = 0.6  # rad/s, of a joint that runs away
_LATE = 0.1  # s, by which a sluggish joint is behind at last
_FALLING = 0.1  # s behind per second, until then
_WORKS_ON = 4.0  # s, recorded after an encoder stuck
_SETTLING = 1.5  # s, recorded after the last motion: longer than missed goals are waited for


class Driver(Node):
    """A simulated arm whose driver reports one joint wrongly for a while."""

    def __init__(self, chain: SerialChain, start: Array, case: Case) -> None:
        super().__init__('driver')
        self._chain = chain
        self._case = case
        self._arm = SimulatedArm(chain, SimSettings(seed=case.seed), start=start, time=self._now())
        self._begun: float | None = None
        self._past: deque[Array] = deque(maxlen=3 + round(_LATE / _PERIOD))
        self._publisher = self.create_publisher(JointState, topics.JOINT_STATES, topics.SENSOR_QOS)
        self.create_subscription(
            JointTrajectory, topics.JOINT_TRAJECTORY, self._on_trajectory, topics.COMMAND_QOS
        )
        self.create_timer(_PERIOD, self._on_tick)

    def _now(self) -> float:
        return float(self.get_clock().now().nanoseconds) * 1e-9

    def _on_trajectory(self, message: JointTrajectory) -> None:
        start = seconds(message.header.stamp)
        self._begun = start if self._begun is None else self._begun
        self._arm.advance(self._now())
        try:
            self._arm.follow(path_from_message(message, self._chain.joint_names), start)
        except InputError as error:
            # As a controller does: what it cannot follow it refuses, and stands still.
            self.get_logger().error(str(error))

    def _on_tick(self) -> None:
        now = self.get_clock().now()
        time = float(now.nanoseconds) * 1e-9
        self._arm.advance(time)
        position, velocity = self._arm.measure()
        self._past.append(np.array([position, velocity]))
        message = JointState(name=list(self._chain.joint_names))
        message.header.stamp = now.to_msg()
        kind, joint, moment = self._case.corrupt or ('', '', 0.0)
        since = time - self._begun - moment if self._begun is not None else -1.0
        keep = list(range(self._chain.n))
        if since >= 0.0:
            j = self._chain.index(joint)
            if kind == 'runaway':
                position[j] += _DRIFT * min(since, _SPELL)
            elif since < _SPELL and kind == 'nan':
                position[j] = np.nan
            elif since < _SPELL and kind == 'missing':
                keep.remove(j)
            elif kind == 'late':
                # It falls behind little by little: a joint does not jump back.
                behind = min(min(_FALLING * since, _LATE) / _PERIOD, len(self._past) - 2)
                k, part = int(behind), behind % 1.0
                past = (1.0 - part) * self._past[-1 - k] + part * self._past[-2 - k]
                position[j] = past[0, j]
                velocity[j] = past[1, j] * (1.0 - _FALLING * (_FALLING * since < _LATE))
        message.name = [message.name[k] for k in keep]
        message.position = position[keep].tolist()
        message.velocity = velocity[keep].tolist()
        self._publisher.publish(message)


def record(case: Case, bag: Path, logs: Path) -> None:
    """Run the nodes, make the failures happen, and leave the recorder's bag."""
    arm = {'arm': case.arm, 'base': case.base, 'tip': case.tip}
    chain = load_arm(case.arm, base=case.base or None, tip=case.tip or None)
    own = HERE / f'{case.task}.yaml'
    task = load_task(own if own.is_file() else case.task)
    start = _start(chain, case)
    nodes = {
        'recorder': {
            'output': str(bag),
            'seed': case.seed,
            'note': f'case {case.name}',
            # Logs and diagnostics tell of this machine's folders, and nothing that is replayed.
            'topics': [name for name in TOPICS if name not in ('/rosout', topics.DIAGNOSTICS)],
        },
        'fault_monitor': {**arm, **case.monitor},
        'replanner': arm,
        'workspace': arm,
        'arm_sim': {**arm, 'start': start.tolist(), 'seed': case.seed, **case.sim},
    }
    if case.corrupt:
        del nodes['arm_sim']
    if not case.query:
        del nodes['workspace']
    with own_domain(None), Processes(logs) as processes:
        rclpy.init()
        observer = Observer()
        observer.trigger_configure()
        observer.trigger_activate()
        try:
            if case.corrupt:
                driver = Driver(chain, start, case)
                observer._executor_kept.add_node(driver)
            for node, parameters in nodes.items():
                processes.start(node, parameters)
            observer.alarm = processes.dead
            for node in nodes:
                observer.until_active(node, 180.0)
            _tell(case, chain, task, observer, [n for n in nodes if n != 'recorder'], processes)
        finally:
            observer.close()
            processes.stop()
            rclpy.try_shutdown()


def _start(chain: SerialChain, case: Case) -> Array:
    middle = 0.5 * (chain.operating_lower + chain.operating_upper)
    half = 0.5 * (chain.operating_upper - chain.operating_lower)
    rng = np.random.default_rng(case.seed)
    return middle + 0.5 * half * rng.uniform(-1.0, 1.0, chain.n)


def _tell(
    case: Case,
    chain: SerialChain,
    task: object,
    observer: Observer,
    nodes: list[str],
    processes: Processes,
) -> None:
    log = processes.logs / 'recorder.log'
    texts = [f'has the parameters of /{node}' for node in nodes]
    observer.until(
        lambda: all(text in log.read_text() for text in texts), 30.0, 'the recorder to be ready'
    )
    if case.query:
        points = [goal.position for goal in task.goals] + [np.array(p) for p in case.query]
        request = QueryFtws.Request(poses=[pose_to_message(p) for p in points], intervals=True)
        observer.call(QueryFtws, topics.QUERY_FTWS, request, timeout=120.0)
    observer.publish_task(task_to_message(task, observer.now(), 'base_link'))
    message = observer.until(lambda: observer.trajectories, 20.0, 'a trajectory')[0][1]
    began = nanoseconds(message.header.stamp)
    for joint, moment in case.locks:
        request = InjectFault.Request(joint=joint, kind=InjectFault.Request.LOCK)
        request.delay = max(began * 1e-9 + moment - observer.now() * 1e-9, 0.0)
        observer.call(InjectFault, topics.INJECT_FAULT, request, timeout=5.0)
    if case.slow:
        joint, moment, lag = case.slow
        request = InjectFault.Request(joint=joint, kind=InjectFault.Request.SLUGGISH, lag=lag)
        request.delay = max(began * 1e-9 + moment - observer.now() * 1e-9, 0.0)
        observer.call(InjectFault, topics.INJECT_FAULT, request, timeout=5.0)
    if case.stuck:
        joint, moment = case.stuck
        request = InjectFault.Request(joint=joint, kind=InjectFault.Request.STUCK_ENCODER)
        request.delay = max(began * 1e-9 + moment - observer.now() * 1e-9, 0.0)
        observer.call(InjectFault, topics.INJECT_FAULT, request, timeout=5.0)
    if case.manual:
        observer.until(lambda: observer.now() > began + _SECOND, 5.0, 'the motion')
        freeze = FreezeJoint.Request(joint=case.manual, at_measured=True, reason='brake set')
        observer.call(FreezeJoint, topics.FREEZE_JOINT, freeze, timeout=5.0)
    observer.until(lambda: _finished(observer, case), 120.0, 'the end of the motion')
    if case.manual:
        clear = ClearFault.Request(joint=case.manual, reason='brake released')
        observer.call(ClearFault, topics.CLEAR_FAULT, clear, timeout=5.0)
        later = observer.now() + _SECOND
        observer.until(lambda: observer.now() > later, 5.0, 'a last look')


def _finished(observer: Observer, case: Case) -> bool:
    """Whether the last motion is over and as many plans were made as joints failed."""
    plans = [message for _, message in observer.plans]
    if len({len(plan.frozen_joints) for plan in plans}) < len(case.locks):
        return False
    if case.stuck:
        # The arm works on; before it misses the goals that its encoder denies.
        begun = nanoseconds(observer.trajectories[0][1].header.stamp)
        return observer.now() > begun + _SECOND * (case.stuck[1] + _WORKS_ON)
    _, last = observer.trajectories[-1]
    end = nanoseconds(last.header.stamp) + _SECOND * (
        seconds(last.points[-1].time_from_start) + _SETTLING
    )
    return observer.now() > end
