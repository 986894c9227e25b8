"""Node `replanner`: executes a task, and on a failure plans what is left of it."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from nav_msgs.msg import Path
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from ft_manip_interfaces.msg import FaultState, RecoveryPlan
from ft_manip_interfaces.msg import Task as TaskMessage
from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.planning.collision import CollisionChecker
from ft_manip_ros.core.planning.collision_setup import make_checker
from ft_manip_ros.core.planning.decision import Decision
from ft_manip_ros.core.planning.executive import Executive
from ft_manip_ros.core.planning.limits import joint_limits_yaml
from ft_manip_ros.core.planning.plan import Plan
from ft_manip_ros.core.planning.proof import Proof, needs_proof, prove
from ft_manip_ros.core.planning.trajectory import Trajectory
from ft_manip_ros.core.planning.warm_up import warm_up
from ft_manip_ros.core.urdf_writer import chain_to_urdf
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.arm_model import arm_source
from ft_manip_ros.nodes.conversions import (
    nanoseconds,
    task_from_message,
    trajectory_to_message,
)
from ft_manip_ros.nodes.managed_node import ManagedNode
from ft_manip_ros.nodes.plan_messages import (
    frozen_from_message,
    goal_markers,
    plan_to_message,
    tool_path,
)
from ft_manip_ros.nodes.process import run
from ft_manip_ros.nodes.replanner_parameters import (
    PARAMETERS,
    collision_options,
    planning_settings,
    watching_settings,
)

TASK_PLAN = 'replanner/task_plan'  # RecoveryPlan for the healthy arm, latched
REDUCED = 'replanner/reduced_description'  # std_msgs/String, URDF of the ROD, latched
LIMITS = 'replanner/joint_limits'  # std_msgs/String, limits of the ROD as MoveIt reads, latched
TOOL_PATH = 'replanner/path'  # nav_msgs/Path, latched

_PROOF_POLL = 0.02  # s


class Replanner(ManagedNode):
    """Joint states, tasks and fault states in; trajectories and plan reports out."""

    def __init__(self) -> None:
        super().__init__('replanner', PARAMETERS)

    def configure(self) -> None:
        """Load the arm, read the settings, open the topics."""
        source, base = arm_source(self), self.param('base') or None
        self._chain = load_arm(source, base=base, tip=self.param('tip') or None)
        self._settings = planning_settings(self)
        self._executive = Executive(
            self._chain,
            self._settings,
            watching_settings(self),
            self._checker(source, base),
            lambda: int(self.get_clock().now().nanoseconds),
            self._stop_first,
        )
        # The message that a plan is owed to, and when it came.
        self._owed: tuple[Header, float] | None = None
        self._frame = ''
        self._described: dict[str, float] = {}
        self._trajectories = self.advertise(
            JointTrajectory, topics.JOINT_TRAJECTORY, topics.TRAJECTORY_QOS
        )
        self._plans = self.advertise(RecoveryPlan, topics.RECOVERY_PLAN, topics.LATCHED_QOS)
        self._task_plans = self.advertise(RecoveryPlan, TASK_PLAN, topics.LATCHED_QOS)
        self._markers = self.advertise(
            MarkerArray, topics.markers('replanner'), topics.LATCHED_QOS
        )
        self._reduced = self.advertise(String, REDUCED, topics.LATCHED_QOS)
        self._limits = self.advertise(String, LIMITS, topics.LATCHED_QOS)
        self._paths = self.advertise(Path, TOOL_PATH, topics.LATCHED_QOS)
        # Proofs take long and hold no lock: they run beside the callbacks.
        self._prover = ThreadPoolExecutor(max_workers=1)
        self._proof: tuple[Decision, Header, Future[Proof]] | None = None
        self.every(_PROOF_POLL, self._on_proof_timer)
        self.subscribe(JointState, topics.JOINT_STATES, self._on_joint_state, topics.SENSOR_QOS)
        self.subscribe(TaskMessage, topics.TASK, self._on_task, topics.LATCHED_QOS)
        self.subscribe(FaultState, topics.FAULT_STATE, self._on_fault_state, topics.LATCHED_QOS)

    def _checker(self, arm: str, base: str | None) -> CollisionChecker | None:
        options = collision_options(self)
        if options is None:
            return None
        checker = make_checker(self._chain, arm, base, options)
        bodies = checker.bodies
        self.get_logger().info(
            f'collision: {bodies.source}, {len(bodies.geometry.collisionPairs)} pairs; touching '
            f'in nearly every posture and so not checked: {len(bodies.ignored)}'
        )
        return checker

    def warm_up(self) -> None:
        """Compile what a fault will need."""
        warm_up(self._chain, self._settings)

    def release(self) -> None:
        """End the thread that proves."""
        if hasattr(self, '_prover'):
            self._prover.shutdown(wait=False, cancel_futures=True)

    def _on_proof_timer(self) -> None:
        if self._proof is None or not self._proof[2].done():
            return
        decision, header, future = self._proof
        self._proof = None
        arrived = time.monotonic()
        self._carry_out(self._executive.on_proof(decision, future.result()), header, arrived)

    def _on_joint_state(self, message: JointState) -> None:
        arrived = time.monotonic()
        names = list(message.name)
        if len(message.position) != len(names):
            raise InputError(
                'joint state: position', f'has {len(message.position)} values, {len(names)} names'
            )
        velocities = None
        if len(message.velocity) == len(names):
            velocities = dict(zip(names, message.velocity, strict=True))
        visited, decision = self._executive.on_joint_state(
            nanoseconds(message.header.stamp),
            dict(zip(names, message.position, strict=True)),
            velocities,
        )
        for goal in visited:
            self.get_logger().info(
                f'goal {goal.id or goal.index} reached within {goal.position_error * 1e3:.3f} mm'
            )
        if decision is not None:
            self._carry_out(decision, *(self._owed or (message.header, arrived)))

    def _on_task(self, message: TaskMessage) -> None:
        arrived = time.monotonic()
        task = task_from_message(message)
        self._frame = message.header.frame_id
        self._carry_out(self._executive.on_task(task), message.header, arrived)

    def _on_fault_state(self, message: FaultState) -> None:
        arrived = time.monotonic()
        faults = frozen_from_message(message)
        decision = self._executive.on_fault_state(nanoseconds(message.header.stamp), *faults)
        self._carry_out(decision, message.header, arrived)
        self._describe_arm(faults[0])

    def _stop_first(self, motion: Trajectory, start: int) -> None:
        """Stop the arm before a plan that has to look for ways among bodies."""
        self._trajectories.publish(trajectory_to_message(motion, start))

    def _carry_out(self, decision: Decision | None, header: Header, arrived: float) -> None:
        """Send what was decided; ``header`` is that of the message which it answers."""
        if decision is None:
            if self._executive.waiting:
                self._owed = header, arrived
            return
        self._owed = None
        task = self._executive.task
        report = plan_to_message(decision.plan, task.name if task else '', header, decision.stamp)
        if decision.plan.trajectory is not None and not decision.restated:
            self._trajectories.publish(report.trajectory)
        report.compute_time = time.monotonic() - arrived
        (self._plans if decision.degraded else self._task_plans).publish(report)
        self._tell(decision.plan, decision.cause, report.compute_time)
        self._markers.publish(
            goal_markers(decision.plan, self._frame, self.get_clock().now().to_msg())
        )
        self._paths.publish(tool_path(self._chain, decision.plan, self._frame, decision.stamp))
        if needs_proof(decision.plan) and not decision.restated:
            future = self._prover.submit(prove, self._chain, decision.plan, self._settings)
            self._proof = (decision, header, future)

    def _describe_arm(self, frozen: dict[str, float]) -> None:
        """Let other planners go on with the arm as it now is."""
        if frozen == self._described:
            return
        self._described = frozen
        if len(frozen) < self._chain.n:
            self._reduced.publish(String(data=chain_to_urdf(self._chain.freeze(frozen))))
        self._limits.publish(String(data=joint_limits_yaml(self._chain, frozen)))

    def _tell(self, plan: Plan, cause: str, took: float) -> None:
        self.get_logger().info(
            f'{cause}: {plan.status.value}: {plan.reason} (planned in {took * 1e3:.1f} ms)'
        )
        for outcome in plan.outcomes:
            if not outcome.has_posture:
                self.get_logger().warning(
                    f'goal {outcome.goal.id or outcome.index}: {outcome.outcome.value}'
                    f'{" with " + outcome.relaxation if outcome.relaxation else ""}: '
                    f'{outcome.reason}'
                )


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Replanner, args)


if __name__ == '__main__':
    sys.exit(main())
