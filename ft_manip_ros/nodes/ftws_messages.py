"""FTWS questions and answers as messages, and as markers to look at."""

from __future__ import annotations

import math
from collections.abc import Sequence

from geometry_msgs.msg import Point, Pose
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from ft_manip_interfaces.msg import FtwsAnswer
from ft_manip_ros.core.chain import SerialChain
from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.ftws.verdict import FtwsResult, Verdict
from ft_manip_ros.core.goal import Goal
from ft_manip_ros.nodes.conversions import position_from_message, rotation_from_message, stamp

_VERDICTS = {
    Verdict.MEMBER: FtwsAnswer.MEMBER,
    Verdict.NON_MEMBER: FtwsAnswer.NON_MEMBER,
    Verdict.UNDECIDED: FtwsAnswer.UNDECIDED,
}
_BACK = {number: verdict for verdict, number in _VERDICTS.items()}
_COLORS = {
    Verdict.MEMBER: ColorRGBA(r=0.1, g=0.65, b=0.25, a=0.9),
    Verdict.NON_MEMBER: ColorRGBA(r=0.85, g=0.15, b=0.15, a=0.9),
    Verdict.UNDECIDED: ColorRGBA(r=0.95, g=0.7, b=0.1, a=0.9),
}
_MARKER_SIZE = 0.02  # m


def goals_from_poses(poses: Sequence[Pose], mode: str) -> list[Goal]:
    """Goals of a request; only mode ``'pose'`` reads the orientations.

    Raises
    ------
    InputError
        Naming the entry, for NaN, infinity or a quaternion that is not of unit length.
    """
    goals = []
    for i, pose in enumerate(poses):
        orientation = None
        if mode == 'pose':
            orientation = rotation_from_message(pose.orientation, f'poses[{i}].orientation')
        position = position_from_message(pose.position)
        if not all(math.isfinite(x) for x in position):
            raise InputError(f'poses[{i}].position', 'must be three finite numbers (m)')
        goals.append(Goal(position, orientation))
    return goals


def answer_to_message(chain: SerialChain, pose: Pose, result: FtwsResult) -> FtwsAnswer:
    """Answer on one pose of a request."""
    intervals = [
        (name, lower, upper)
        for name in chain.joint_names
        for lower, upper in result.tolerated.get(name, ())
    ]
    fractions = result.surviving_fraction
    return FtwsAnswer(
        pose=pose,
        verdict=_VERDICTS[result.verdict],
        reason=result.reason,
        joints=list(result.joints),
        angles=[float(angle) for angle in result.angles],
        residual=float(result.residual),
        margin=float(result.margin),
        tolerated_joints=[name for name, _, _ in intervals],
        tolerated_lower=[float(lower) for _, lower, _ in intervals],
        tolerated_upper=[float(upper) for _, _, upper in intervals],
        surviving_fraction=[float(fractions[name]) for name in chain.joint_names]
        if fractions
        else [],
        elapsed=float(result.elapsed_s),
    )


def answer_from_message(message: FtwsAnswer, joint_names: Sequence[str]) -> FtwsResult:
    """Answer of a message, as the engine gave it."""
    tolerated: dict[str, list[tuple[float, float]]] = {}
    for name, lower, upper in zip(
        message.tolerated_joints, message.tolerated_lower, message.tolerated_upper, strict=True
    ):
        tolerated.setdefault(name, []).append((lower, upper))
    x, y, z = (float(value) for value in position_from_message(message.pose.position))
    return FtwsResult(
        point=(x, y, z),
        verdict=_BACK[message.verdict],
        reason=message.reason,
        joints=tuple(message.joints),
        angles=tuple(message.angles),
        residual=message.residual,
        margin=message.margin,
        tolerated=tolerated,
        surviving_fraction=dict(zip(joint_names, message.surviving_fraction, strict=False)),
        elapsed_s=message.elapsed,
    )


def answer_markers(answers: Sequence[FtwsAnswer], frame: str, ns: int) -> MarkerArray:
    """Colour every answered point: green member, red non-member, yellow undecided."""
    marker = Marker(ns='ftws', type=Marker.SPHERE_LIST, action=Marker.ADD)
    marker.header.frame_id = frame
    marker.header.stamp = stamp(ns)
    marker.scale.x = marker.scale.y = marker.scale.z = _MARKER_SIZE
    marker.pose.orientation.w = 1.0
    for answer in answers:
        p = answer.pose.position
        marker.points.append(Point(x=p.x, y=p.y, z=p.z))
        marker.colors.append(_COLORS[_BACK[answer.verdict]])
    return MarkerArray(markers=[marker])
