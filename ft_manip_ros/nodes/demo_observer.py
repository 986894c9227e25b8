"""The demo's own node: it hears everything, asks the services, and decides nothing."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from ft_manip_interfaces.msg import DesignCandidate, FaultState, RecoveryPlan
from ft_manip_interfaces.msg import Task as TaskMessage
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.managed_node import ManagedNode

# For a process to import, configure and activate (s). A few seconds, but minutes where kernels
# have to be compiled first: `make warm` does that beforehand.
START_TIME = 300.0
# For a node to do what deactivating asks of it (s), such as finishing a bag.
STOP_TIME = 30.0
_PATIENCE = 5.0  # s, after which a question may have been lost
_REACHED = {
    Transition.TRANSITION_CONFIGURE: State.PRIMARY_STATE_INACTIVE,
    Transition.TRANSITION_ACTIVATE: State.PRIMARY_STATE_ACTIVE,
    Transition.TRANSITION_DEACTIVATE: State.PRIMARY_STATE_INACTIVE,
    Transition.TRANSITION_CLEANUP: State.PRIMARY_STATE_UNCONFIGURED,
}


class StoryError(RuntimeError):
    """Something that the story needs did not happen; the message says what."""


class SilenceError(StoryError):
    """It was waited for in vain."""


class Observer(ManagedNode):
    """Keeps every message of interest with the time at which it arrived (ns of the ROS clock).

    It is spun by whoever waits for something, so nothing runs behind the story's back.
    """

    def __init__(self) -> None:
        super().__init__('demo')
        self._task: Any = None
        self._executor_kept = SingleThreadedExecutor()
        self._executor_kept.add_node(self)
        self.alarm: Callable[[], list[str]] = list
        self.forget()

    def forget(self) -> None:
        """Start a new story: drop what was heard so far."""
        self.states: list[JointState] = []
        self.trajectories: list[tuple[int, JointTrajectory]] = []
        self.faults: list[tuple[int, FaultState]] = []
        self.task_plans: list[tuple[int, RecoveryPlan]] = []
        self.plans: list[tuple[int, RecoveryPlan]] = []
        self.candidates: list[tuple[int, DesignCandidate]] = []
        self.final: DesignCandidate | None = None

    def configure(self) -> None:
        """Subscribe to all that the story is about."""
        # Stamps tell when which point was reached: a late sample counts, a lost one is missed.
        self.subscribe(
            JointState, topics.JOINT_STATES, lambda m: self.states.append(m), topics.EVIDENCE_QOS
        )
        for message_type, topic, name, qos in (
            (JointTrajectory, topics.JOINT_TRAJECTORY, 'trajectories', topics.COMMAND_QOS),
            (FaultState, topics.FAULT_STATE, 'faults', topics.LATCHED_QOS),
            (RecoveryPlan, topics.TASK_PLAN, 'task_plans', topics.LATCHED_QOS),
            (RecoveryPlan, topics.RECOVERY_PLAN, 'plans', topics.LATCHED_QOS),
            (DesignCandidate, topics.DESIGN_CANDIDATES, 'candidates', topics.HISTORY_QOS),
        ):
            self.subscribe(message_type, topic, self._keep_in(name), qos)
        self.subscribe(DesignCandidate, topics.DESIGN_FINAL, self._on_final, topics.LATCHED_QOS)
        self.withdraw_task()

    def now(self) -> int:
        """Time of the ROS clock, ns."""
        return int(self.get_clock().now().nanoseconds)

    def withdraw_task(self) -> None:
        """Take back the task: it is latched, and nodes started later would begin at once."""
        if self._task is not None:
            self.destroy_lifecycle_publisher(self._task)
        self._task = self.advertise(TaskMessage, topics.TASK, topics.LATCHED_QOS)
        if self.active:
            self._task.on_activate(None)

    def publish_task(self, message: TaskMessage) -> None:
        """Set the task, for all who listen and who will."""
        self._task.publish(message)

    def until(self, condition: Callable[[], Any], timeout: float, what: str) -> Any:
        """Spin until ``condition()`` is true and return its value.

        Raises
        ------
        SilenceError
            If it does not come true in time.
        StoryError
            If a process ends in the meantime.
        """
        deadline = time.monotonic() + timeout
        while not (value := condition()):
            dead = self.alarm()
            if dead:
                raise StoryError('; '.join(dead))
            if time.monotonic() > deadline:
                raise SilenceError(f'waited {timeout:g} s in vain for {what}')
            self._executor_kept.spin_once(timeout_sec=0.05)
        return value

    def until_active(self, node: str, timeout: float) -> None:
        """Wait until a lifecycle node is active."""
        deadline = time.monotonic() + timeout
        while True:
            left = max(deadline - time.monotonic(), 0.0)
            if self._state_of(node, left) == State.PRIMARY_STATE_ACTIVE:
                return

    def transit(self, node: str, transition: int, timeout: float) -> None:
        """Lead a lifecycle node through a transition; it is through when this returns."""
        request = ChangeState.Request()
        request.transition.id = transition
        deadline = time.monotonic() + timeout
        while True:
            left = max(deadline - time.monotonic(), 0.0)
            answered = True
            try:
                self.call(
                    ChangeState, f'{node}/change_state', request, timeout=min(left, _PATIENCE)
                )
            except SilenceError:
                # Lost, or still at work: then the state is told after the work is done.
                answered = False
            left = max(deadline - time.monotonic(), 0.0)
            state = self._state_of(node, left)
            if state == _REACHED[transition]:
                return
            if answered:
                raise StoryError(f'{node} refused transition {transition}: it is in state {state}')

    def _state_of(self, node: str, timeout: float) -> int:
        answer = self.call(
            GetState, f'{node}/get_state', GetState.Request(), timeout=timeout, again=_PATIENCE
        )
        return int(answer.current_state.id)

    def until_joined(self, topic: str, *, publishers: int, subscriptions: int) -> None:
        """Wait until a topic has its publishers and subscriptions, this node's included."""
        self.until(
            lambda: (
                self.count_publishers(topic) >= publishers
                and self.count_subscribers(topic) >= subscriptions
            ),
            20.0,
            f'{publishers} publishers and {subscriptions} subscriptions of {topic}',
        )

    def call(
        self,
        service_type: Any,
        name: str,
        request: Any,
        *,
        timeout: float,
        again: float | None = None,
    ) -> Any:
        """Call a service as soon as it exists and return its response.

        Parameters
        ----------
        again
            Ask again after so many seconds without an answer, for questions that may be asked
            twice: a request that is sent while a server is still being discovered can get lost.
        """
        client = self.create_client(service_type, name)
        deadline = time.monotonic() + timeout
        try:
            self.until(client.service_is_ready, timeout, f'service {name}')
            while True:
                future = client.call_async(request)
                left = max(deadline - time.monotonic(), 0.0)
                try:
                    self.until(future.done, min(left, again or left), f'the answer of {name}')
                except SilenceError:
                    if again is None or time.monotonic() > deadline:
                        raise
                    continue
                return future.result()
        finally:
            self.destroy_client(client)

    def close(self) -> None:
        """Release everything."""
        self._executor_kept.shutdown(timeout_sec=0.0)
        self.shut_down()
        self.destroy_node()

    def _keep_in(self, name: str) -> Callable[[Any], None]:
        return lambda message: getattr(self, name).append((self.now(), message))

    def _on_final(self, message: DesignCandidate) -> None:
        self.final = message
