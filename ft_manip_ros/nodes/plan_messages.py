"""Plans as messages: the report for other programs, markers and a path for the eyes."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, Quaternion
from nav_msgs.msg import Path
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from ft_manip_interfaces.msg import FaultState, GoalReport, JointFault, RecoveryPlan
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.kinematics import fk
from ft_manip_ros.core.planning.plan import GoalOutcome, Outcome, Plan, PlanStatus
from ft_manip_ros.nodes.conversions import pose_to_message, stamp, trajectory_to_message

_OUTCOMES = {
    Outcome.REACHABLE: GoalReport.REACHABLE,
    Outcome.RELAXED: GoalReport.RELAXED,
    Outcome.LOST: GoalReport.LOST,
    Outcome.UNDECIDED: GoalReport.UNDECIDED,
}
_STATUSES = {
    PlanStatus.FINISHES: RecoveryPlan.FINISHES,
    PlanStatus.PARTIAL: RecoveryPlan.PARTIAL,
    PlanStatus.HALTED: RecoveryPlan.HALTED,
    PlanStatus.REFUSED: RecoveryPlan.REFUSED,
}
_COLORS = {
    Outcome.REACHABLE: ColorRGBA(r=0.1, g=0.7, b=0.2, a=0.9),
    Outcome.RELAXED: ColorRGBA(r=0.9, g=0.8, b=0.1, a=0.9),
    Outcome.LOST: ColorRGBA(r=0.8, g=0.1, b=0.1, a=0.9),
    Outcome.UNDECIDED: ColorRGBA(r=0.5, g=0.5, b=0.5, a=0.9),
}
_GOAL_SIZE = 0.03  # m, diameter of a goal's sphere
_LABEL_OFFSET = np.array([0.0, 0.0, _GOAL_SIZE])
_PATH_POINTS = 200


def frozen_from_message(
    message: FaultState,
) -> tuple[dict[str, float], dict[str, float], tuple[str, ...], tuple[str, ...]]:
    """Frozen positions and standard deviations by name; joints that run away; untrusted ones.

    Raises
    ------
    InputError
        Where names and positions differ in number.
    """
    names, positions = list(message.frozen_joints), list(message.frozen_positions)
    if len(names) != len(positions) or len(set(names)) != len(names):
        raise InputError(
            'fault state: frozen_joints',
            f'{names} need one position each, {len(positions)} given, and no name twice',
        )
    sigma = {joint.name: float(joint.frozen_position_sigma) for joint in message.joints}
    runaway, untrusted = (
        tuple(joint.name for joint in message.joints if joint.state == state)
        for state in (JointFault.RUNAWAY, JointFault.SENSOR)
    )
    return dict(zip(names, positions, strict=True)), sigma, runaway, untrusted


def plan_to_message(plan: Plan, task: str, header: Header, start: int) -> RecoveryPlan:
    """Report of a plan; ``start`` is the stamp (ns) of its trajectory's time 0."""
    message = RecoveryPlan(
        header=header,
        task=task,
        status=_STATUSES[plan.status],
        reason=plan.reason,
        frozen_joints=list(plan.frozen),
        frozen_positions=list(plan.frozen.values()),
        frozen_position_sigmas=[plan.sigma.get(name, 0.0) for name in plan.frozen],
        goals=[_goal_to_message(outcome) for outcome in plan.outcomes],
        pause=plan.pause,
    )
    if plan.trajectory is not None:
        message.trajectory = trajectory_to_message(plan.trajectory, start)
    return message


def _goal_to_message(outcome: GoalOutcome) -> GoalReport:
    return GoalReport(
        id=outcome.goal.id,
        index=outcome.index,
        outcome=_OUTCOMES[outcome.outcome],
        relaxation=outcome.relaxation,
        reason=outcome.reason,
        position_error=outcome.position_error,
        orientation_error=outcome.orientation_error,
        arrival=outcome.arrival,
        positions=[] if outcome.posture is None else outcome.posture.tolist(),
    )


def goal_markers(plan: Plan, frame: str, now: Time) -> MarkerArray:
    """A sphere with its name at each goal, coloured by what becomes of it."""
    header = Header(frame_id=frame, stamp=now)
    markers = [Marker(header=header, action=Marker.DELETEALL)]
    for outcome in plan.outcomes:
        place = pose_to_message(outcome.goal.position)
        ball = Marker(
            header=header,
            ns='goals',
            id=outcome.index,
            type=Marker.SPHERE,
            pose=place,
            color=_COLORS[outcome.outcome],
        )
        ball.scale.x = ball.scale.y = ball.scale.z = _GOAL_SIZE
        label = Marker(
            header=header,
            ns='labels',
            id=outcome.index,
            type=Marker.TEXT_VIEW_FACING,
            pose=pose_to_message(outcome.goal.position + _LABEL_OFFSET),
            color=_COLORS[outcome.outcome],
            text=f'{outcome.goal.id or outcome.index}: {outcome.outcome.value}',
        )
        label.scale.z = _GOAL_SIZE
        markers += [ball, label]
    return MarkerArray(markers=markers)


def tool_path(chain: SerialChain, plan: Plan, frame: str, start: int) -> Path:
    """Way of the tool along a plan's trajectory; ``start`` is the stamp (ns) of its time 0."""
    message = Path(header=Header(frame_id=frame, stamp=stamp(start)))
    trajectory = plan.trajectory
    if trajectory is None:
        return message
    count = len(trajectory.times)
    rows = np.unique(np.linspace(0, count - 1, min(count, _PATH_POINTS)).round().astype(int))
    rotations, positions = fk(chain, trajectory.positions[rows])
    # The planner's warm-up has imported it; a replay, which publishes nothing, never does.
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_matrix(rotations).as_quat(canonical=True).tolist()
    for time, (x, y, z, w), place in zip(trajectory.times[rows], turns, positions, strict=True):
        pose = PoseStamped(pose=pose_to_message(place))
        pose.pose.orientation = Quaternion(x=x, y=y, z=z, w=w)
        pose.header.frame_id = frame
        pose.header.stamp = stamp(start + round(float(time) * 1e9))
        message.poses.append(pose)
    return message
