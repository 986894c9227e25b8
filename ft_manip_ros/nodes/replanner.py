"""Node `replanner`: executes a task, and on a failure plans what is left of it."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from nav_msgs.msg import Path
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from ft_manip_interfaces.msg import FaultState, RecoveryPlan
from ft_manip_interfaces.msg import Task as TaskMessage
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.planning.decision import Decision, ExecutiveSettings
from ft_manip_ros.core.planning.executive import Executive
from ft_manip_ros.core.planning.limits import joint_limits_yaml
from ft_manip_ros.core.planning.plan import Plan
from ft_manip_ros.core.planning.proof import Proof, needs_proof, prove
from ft_manip_ros.core.planning.settings import Order, PlanSettings, Policy, Relaxation
from ft_manip_ros.core.planning.warm_up import warm_up
from ft_manip_ros.core.urdf_writer import chain_to_urdf
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.arm_model import load_arm_parameter
from ft_manip_ros.nodes.conversions import nanoseconds, task_from_message
from ft_manip_ros.nodes.managed_node import ManagedNode
from ft_manip_ros.nodes.parameters import ARM_PARAMETERS, ParameterSpec
from ft_manip_ros.nodes.plan_messages import (
    frozen_from_message,
    goal_markers,
    plan_to_message,
    tool_path,
)
from ft_manip_ros.nodes.process import run

TASK_PLAN = 'replanner/task_plan'  # RecoveryPlan for the healthy arm, latched
REDUCED = 'replanner/reduced_description'  # std_msgs/String, URDF of the ROD, latched
LIMITS = 'replanner/joint_limits'  # std_msgs/String, limits of the ROD as MoveIt reads, latched
TOOL_PATH = 'replanner/path'  # nav_msgs/Path, latched

_PROOF_POLL = 0.02  # s

PARAMETERS = (
    *ARM_PARAMETERS,
    ParameterSpec(
        'policy',
        Policy.FINISH_REACHABLE.value,
        'What to do when a joint has failed.',
        choices=tuple(policy.value for policy in Policy),
    ),
    ParameterSpec(
        'order',
        Order.GIVEN.value,
        'In which order to visit the goals that remain.',
        choices=tuple(order.value for order in Order),
    ),
    ParameterSpec(
        'accepted_relaxations',
        Parameter.Type.STRING_ARRAY,
        'With which relaxations a goal may still be visited: '
        + ', '.join(repr(relaxation.value) for relaxation in Relaxation)
        + '; with others it is only reported.',
    ),
    ParameterSpec('postures', 8, 'Postures to look for per goal.', '', 1, 64),
    ParameterSpec('attempts', 24, 'Solver starts per goal.', '', 1, 10_000),
    ParameterSpec(
        'proof_boxes',
        50_000,
        'Branch-and-bound boxes per goal to prove it lost, after the plan has left.',
        '',
        1,
        100_000_000,
    ),
    ParameterSpec('dwell', 0.2, 'Rest at each goal.', 's', 0.0, 60.0),
    ParameterSpec(
        'rate_scale',
        0.95,
        'Share of the speed, acceleration and jerk limits to use.',
        '',
        0.01,
        1.0,
    ),
    ParameterSpec('jerk_time', 0.1, 'Time to build up full acceleration.', 's', 0.001, 10.0),
    ParameterSpec(
        'sample_period', 0.1, 'Longest time between two trajectory points.', 's', 0.001, 1.0
    ),
    ParameterSpec(
        'limit_weight',
        0.0,
        'What a posture at a joint limit costs more than one in the middle of all ranges.',
        's',
        0.0,
        1000.0,
    ),
    ParameterSpec('seed', 0, 'Seed of the random solver starts.', '', 0, 2**31 - 1),
    ParameterSpec(
        'state_timeout',
        0.5,
        'A measured state older than this is not planned from.',
        's',
        0.01,
        60.0,
    ),
    ParameterSpec(
        'patience',
        1.0,
        'How long after the last arrival missed goals are tried again.',
        's',
        0.1,
        60.0,
    ),
    ParameterSpec('retries', 2, 'How often missed goals are tried again.', '', 0, 100),
)


class Replanner(ManagedNode):
    """Joint states, tasks and fault states in; trajectories and plan reports out."""

    def __init__(self) -> None:
        super().__init__('replanner', PARAMETERS)

    def configure(self) -> None:
        """Load the arm, read the settings, open the topics."""
        self._chain = load_arm_parameter(self)
        self._settings = PlanSettings(
            policy=Policy(self.param('policy')),
            order=Order(self.param('order')),
            accepted=frozenset(_relaxation(name) for name in self.param('accepted_relaxations')),
            postures=self.param('postures'),
            attempts=self.param('attempts'),
            proof_boxes=self.param('proof_boxes'),
            dwell=self.param('dwell'),
            rate_scale=self.param('rate_scale'),
            jerk_time=self.param('jerk_time'),
            sample_period=self.param('sample_period'),
            limit_weight=self.param('limit_weight'),
            seed=self.param('seed'),
        )
        watching = ExecutiveSettings(
            state_timeout=self.param('state_timeout'),
            patience=self.param('patience'),
            retries=self.param('retries'),
        )
        self._executive = Executive(self._chain, self._settings, watching)
        self._frame = ''
        self._described: dict[str, float] = {}
        self._trajectories = self.advertise(
            JointTrajectory, topics.JOINT_TRAJECTORY, topics.COMMAND_QOS
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
        self._carry_out(decision, message.header, arrived)

    def _on_task(self, message: TaskMessage) -> None:
        arrived = time.monotonic()
        task = task_from_message(message)
        self._frame = message.header.frame_id
        self._carry_out(self._executive.on_task(task), message.header, arrived)

    def _on_fault_state(self, message: FaultState) -> None:
        arrived = time.monotonic()
        frozen, sigma, runaway = frozen_from_message(message)
        decision = self._executive.on_fault_state(
            nanoseconds(message.header.stamp), frozen, sigma, runaway
        )
        self._carry_out(decision, message.header, arrived)
        self._describe_arm(frozen)

    def _carry_out(self, decision: Decision | None, header: Header, arrived: float) -> None:
        """Send what was decided; ``header`` is that of the message which it answers."""
        if decision is None:
            return
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


def _relaxation(name: str) -> Relaxation:
    try:
        return Relaxation(name)
    except ValueError:
        raise InputError(
            'parameter accepted_relaxations',
            f'has {name!r}; known are {", ".join(repr(r.value) for r in Relaxation)}',
        ) from None


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(Replanner, args)


if __name__ == '__main__':
    sys.exit(main())
