"""Node `arm_sim`: a simulated arm behind the topics of a joint_trajectory_controller."""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from ft_manip_interfaces.srv import InjectFault
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.sim import SimSettings, SimulatedArm
from ft_manip_ros.nodes import topics
from ft_manip_ros.nodes.arm_model import load_arm_parameter
from ft_manip_ros.nodes.conversions import path_from_message, pose_to_message, seconds, stamp
from ft_manip_ros.nodes.managed_node import ManagedNode
from ft_manip_ros.nodes.parameters import ARM_PARAMETERS, ParameterSpec
from ft_manip_ros.nodes.process import run

PARAMETERS = (
    *ARM_PARAMETERS,
    ParameterSpec('rate', 100.0, 'How often joint states are published.', 'Hz', 1.0, 1000.0),
    ParameterSpec(
        'start',
        Parameter.Type.DOUBLE_ARRAY,
        'Where the joints stand at first, base to tip; empty: 0, or the middle of the limits.',
        'rad or m',
    ),
    ParameterSpec(
        'servo_frequency',
        60.0,
        'Natural frequency of each servo; it follows 2 / servo_frequency seconds late.',
        'rad/s',
        1.0,
        500.0,
    ),
    ParameterSpec(
        'noise', 2e-5, 'Standard deviation of a position reading.', 'rad or m', 0.0, 0.1
    ),
    ParameterSpec(
        'velocity_noise',
        1e-3,
        'Standard deviation of a velocity reading.',
        'rad/s or m/s',
        0.0,
        10.0,
    ),
    ParameterSpec('resolution', 1e-5, 'Step of a position reading.', 'rad or m', 0.0, 0.1),
    ParameterSpec(
        'drop_fraction', 0.0, 'Share of joint states that are lost on the way.', '', 0.0, 1.0
    ),
    ParameterSpec(
        'reorder_fraction', 0.0, 'Share of joint states sent after the next one.', '', 0.0, 1.0
    ),
    ParameterSpec(
        'tool_pose_rate',
        0.0,
        'How often the pose of the tool is published, as a tracker sees it; 0: never.',
        'Hz',
        0.0,
        1000.0,
    ),
    ParameterSpec(
        'tool_noise', 5e-4, 'Standard deviation of a coordinate of the tool.', 'm', 0.0, 0.1
    ),
    ParameterSpec('frame', 'base_link', 'Frame of poses of the tool: the base of the arm.'),
    ParameterSpec('seed', 0, 'Seed of noise, losses and reordering.', '', 0, 2**31 - 1),
)


class ArmSim(ManagedNode):
    """Follows trajectories, reports joint states, and lets joints fail on request."""

    def __init__(self) -> None:
        super().__init__('arm_sim', PARAMETERS)

    def configure(self) -> None:
        """Build the arm; it starts to move in time when the node is activated."""
        self._chain = load_arm_parameter(self)
        start = self.param('start')
        if len(start) not in (0, self._chain.n):
            raise InputError(
                'parameter start', f'has {len(start)} values; {self._chain.n} joints need one each'
            )
        self._settings = SimSettings(
            servo_frequency=self.param('servo_frequency'),
            noise=self.param('noise'),
            velocity_noise=self.param('velocity_noise'),
            resolution=self.param('resolution'),
            seed=self.param('seed'),
        )
        self._home = np.array(start) if len(start) else None
        self._drop = self.param('drop_fraction')
        self._reorder = self.param('reorder_fraction')
        # Losses must not change the noise.
        self._transport = np.random.default_rng([self._settings.seed, 1])
        self._tracker = np.random.default_rng([self._settings.seed, 2])
        self._late: JointState | None = None
        self._arm = self._new_arm()
        self._states = self.advertise(JointState, topics.JOINT_STATES, topics.SENSOR_QOS)
        self.subscribe(
            JointTrajectory, topics.JOINT_TRAJECTORY, self._on_trajectory, topics.COMMAND_QOS
        )
        self.serve(InjectFault, topics.INJECT_FAULT, self._on_inject_fault)
        self.every(1.0 / self.param('rate'), self._on_tick)
        if self.param('tool_pose_rate') > 0.0:
            self._tool = self.advertise(PoseStamped, topics.TOOL_POSE, topics.SENSOR_QOS)
            self.every(1.0 / self.param('tool_pose_rate'), self._on_tool_tick)

    def warm_up(self) -> None:
        """Load the kinematics, where poses of the tool are wanted."""
        if self.param('tool_pose_rate') > 0.0:
            # Brings the compiler, which takes a second and nothing else here needs.
            from ft_manip_ros.core.kinematics import fk

            self._fk = fk
            fk(self._chain, self._arm.position)

    def activate(self) -> None:
        """Stand still where the arm stands; failed joints stay failed."""
        locked = self._arm.locked_joints
        self._home = self._arm.position
        self._arm = self._new_arm()
        for name in locked:
            self._arm.lock(name, self._arm.time)

    def _new_arm(self) -> SimulatedArm:
        return SimulatedArm(self._chain, self._settings, start=self._home, time=self._now())

    def _now(self) -> float:
        return float(self.get_clock().now().nanoseconds) * 1e-9

    def _on_trajectory(self, message: JointTrajectory) -> None:
        path = path_from_message(message, self._chain.joint_names)
        self._arm.advance(self._now())
        start = seconds(message.header.stamp)
        self._arm.follow(path, start if start > 0.0 else None)
        self.get_logger().info(
            f'following a trajectory of {len(path.times)} points, {path.duration:.3f} s'
        )

    def _on_inject_fault(
        self, request: InjectFault.Request, response: InjectFault.Response
    ) -> InjectFault.Response:
        if not (np.isfinite(request.delay) and request.delay >= 0.0):
            raise InputError('delay', f'is {request.delay}; must be finite and at least 0 s')
        self._arm.advance(self._now())
        time = max(self._arm.time, self._now()) + request.delay
        if request.kind == InjectFault.Request.LOCK:
            verb = 'locks'
            self._arm.lock(request.joint, time)
        elif request.kind == InjectFault.Request.RELEASE:
            verb = 'works again'
            self._arm.release(request.joint, time)
        elif request.kind == InjectFault.Request.SLUGGISH:
            verb = f'falls behind by {request.lag:g} s'
            self._arm.slow(request.joint, time, request.lag)
        elif request.kind == InjectFault.Request.STUCK_ENCODER:
            verb = 'has a stuck encoder'
            self._arm.stick(request.joint, time)
        else:
            raise InputError(
                'kind',
                f'is {request.kind}; must be 0 (lock), 1 (release), 2 (sluggish) or 3 (stuck '
                'encoder)',
            )
        response.success = True
        response.message = f'{request.joint} {verb}'
        if request.delay > 0.0:
            response.message += f' in {request.delay:g} s'
        response.stamp = stamp(round(time * 1e9))
        response.position = float(self._arm.position[self._chain.index(request.joint)])
        return response

    def _on_tick(self) -> None:
        now = self.get_clock().now()
        self._arm.advance(float(now.nanoseconds) * 1e-9)
        position, velocity = self._arm.measure()
        message = JointState(
            name=list(self._chain.joint_names),
            position=position.tolist(),
            velocity=velocity.tolist(),
        )
        message.header.stamp = now.to_msg()
        self._send(message)

    def _on_tool_tick(self) -> None:
        now = self.get_clock().now()
        self._arm.advance(float(now.nanoseconds) * 1e-9)
        rotation, position = self._fk(self._chain, self._arm.position)
        seen = position + self.param('tool_noise') * self._tracker.standard_normal(3)
        message = PoseStamped(pose=pose_to_message(seen, rotation))
        message.header.stamp = now.to_msg()
        message.header.frame_id = self.param('frame')
        self._tool.publish(message)

    def _send(self, message: JointState) -> None:
        """Publish over a transport that may lose messages and let one overtake another."""
        lost, late = self._transport.random(2)
        if lost < self._drop:
            return
        if late < self._reorder and self._late is None:
            self._late = message
            return
        self._states.publish(message)
        if self._late is not None:
            self._states.publish(self._late)
            self._late = None


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run(ArmSim, args)


if __name__ == '__main__':
    sys.exit(main())
