"""A chain as a Pinocchio model: for independent checks, dynamics and collision."""

from __future__ import annotations

import numpy as np
import pinocchio

from ft_manip_ros.core.chain import SerialChain

TOOL_FRAME = 'tool'


def model_from_chain(chain: SerialChain) -> pinocchio.Model:
    """Return a Pinocchio model with the chain's axes, in its order, and the frame ``tool``.

    Every joint has one coordinate, also those of a full turn (revolute, not Pinocchio's
    unbounded kind with a point on the circle), so that q is the chain's own joint vector; for
    an arm with mimic joints it is `SerialChain.axis_positions`.
    """
    model = pinocchio.Model()
    model.name = chain.name
    parent = 0
    joints = chain.uncoupled.joints
    for i, joint in enumerate(joints):
        kind = pinocchio.JointModelPZ() if joint.prismatic else pinocchio.JointModelRZ()
        placement = pinocchio.SE3(chain.rotations[i].copy(), chain.translations[i].copy())
        parent = model.addJoint(
            parent,
            kind,
            placement,
            joint.name,
            np.array([np.inf]),
            np.array([joint.velocity]),
            np.array([joint.lower]),
            np.array([joint.upper]),
        )
        # `buildReducedModel` looks frames up by the frame of the joint before them.
        model.addJointFrame(parent, -1)
    tool = pinocchio.SE3(chain.rotations[-1].copy(), chain.translations[-1].copy())
    previous = model.getFrameId(joints[-1].name) if joints else 0
    model.addFrame(
        pinocchio.Frame(TOOL_FRAME, parent, previous, tool, pinocchio.FrameType.OP_FRAME)
    )
    return model
