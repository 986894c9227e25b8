"""A joint locks: find it from the joint states, plan what is left, and get there. No ROS needed.

python examples/survive_a_lock.py
"""

import numpy as np

from ft_manip_ros.core.arm_file import load_arm
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.detection.monitor import FaultMonitor
from ft_manip_ros.core.detection.states import JointState, Report
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.planning.plan import Plan
from ft_manip_ros.core.planning.replan import plan_task
from ft_manip_ros.core.planning.settings import PlanSettings
from ft_manip_ros.core.planning.trajectory import Trajectory
from ft_manip_ros.core.sim import SimulatedArm
from ft_manip_ros.core.task_file import load_task

PERIOD = 0.01  # s between joint states


def watch(
    robot: SimulatedArm, monitor: FaultMonitor, motion: Trajectory, until: float
) -> Report | None:
    """Execute a motion, sample by sample, until it is over or a joint is found locked."""
    robot.follow(motion.path(), robot.time)
    points = zip(
        motion.times, motion.positions, motion.velocities, motion.accelerations, strict=True
    )
    monitor.trajectory(nanoseconds(robot.time), motion.joint_names, list(points))
    while robot.time < until:
        robot.advance(robot.time + PERIOD)
        positions, velocities = robot.measure()
        names = robot.chain.joint_names
        for edge in monitor.sample(
            nanoseconds(robot.time),
            dict(zip(names, positions, strict=True)),
            dict(zip(names, velocities, strict=True)),
        ):
            if edge.report.state is JointState.LOCKED:
                return edge.report
    return None


def nanoseconds(time: float) -> int:
    """Return a stamp."""
    return round(time * 1e9)


def tell(chain: SerialChain, plan: Plan) -> None:
    """Print what becomes of each goal."""
    print(f'{plan.status.value}: {plan.reason}')
    for outcome in plan.outcomes:
        print(f'    {outcome.goal.id}: {outcome.outcome.value}, at {outcome.arrival:.2f} s')


def main() -> None:
    """Run the story."""
    chain = load_arm('paredis_table_3')
    goals = list(enumerate(load_task('paredis_eq_11').goals))
    robot, monitor = SimulatedArm(chain), FaultMonitor(chain.joints)
    still = np.zeros(chain.n)
    settings = PlanSettings()
    plan = plan_task(
        chain, goals, frozen={}, sigma={}, start=still, start_velocity=still, settings=settings
    )
    assert plan.trajectory is not None
    tell(chain, plan)
    # Nobody is told of this:
    robot.lock('joint_3', 0.8)
    report = watch(robot, monitor, plan.trajectory, plan.trajectory.duration)
    assert report is not None
    print(f'{robot.time:.2f} s: {report.name} is locked at {report.frozen_position:.4f} rad')
    plan = plan_task(
        chain,
        goals,
        frozen=monitor.frozen(),
        sigma={report.name: report.frozen_position_sigma},
        start=robot.position,
        start_velocity=robot.velocity,
        settings=settings,
    )
    assert plan.trajectory is not None
    tell(chain, plan)
    began = robot.time
    watch(robot, monitor, plan.trajectory, began + plan.trajectory.duration + 0.3)
    _, tool = fk(chain, robot.position)
    last = max(plan.outcomes, key=lambda outcome: outcome.arrival)
    error = np.linalg.norm(tool - last.goal.position)
    print(f'the tool ends {error * 1e3:.3f} mm from {last.goal.id}')


if __name__ == '__main__':
    main()
