"""Names and quality of service of everything on the graph; relative, so namespaces work."""

from __future__ import annotations

from typing import Final

from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSProfile,
    ReliabilityPolicy,
    qos_profile_sensor_data,
)


def reliable(depth: int) -> QoSProfile:
    """Reliable and volatile, keeping the last ``depth`` messages."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.VOLATILE,
    )


def latched(depth: int = 1) -> QoSProfile:
    """Reliable, and the last ``depth`` messages also reach those who subscribe later."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


# Best effort: for what acts on the latest sample, a late one is worth nothing.
SENSOR_QOS: Final = qos_profile_sensor_data
# For what judges by stamps a late sample is worth as much as any, and a lost one is lost evidence:
# room for a machine that stutters.
EVIDENCE_QOS: Final = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=500,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)
COMMAND_QOS: Final = reliable(10)
# Controllers ask for less; a recorder that is discovered late still gets the latest commands.
TRAJECTORY_QOS: Final = latched(10)
EVENT_QOS: Final = reliable(100)
LATCHED_QOS: Final = latched()
# A search may be over before anyone has joined, and none of its candidates may be missed.
HISTORY_QOS: Final = latched(1000)
# Every request and response must reach the recorder.
SERVICE_EVENT_QOS: Final = reliable(100)

JOINT_STATES: Final = 'joint_states'  # sensor_msgs/JointState, SENSOR_QOS
JOINT_TRAJECTORY: Final = 'joint_trajectory_controller/joint_trajectory'  # COMMAND_QOS
TOOL_POSE: Final = 'tool_pose'  # geometry_msgs/PoseStamped, SENSOR_QOS
TASK: Final = 'task'  # ft_manip_interfaces/Task, LATCHED_QOS
FAULT_STATE: Final = 'fault_state'  # ft_manip_interfaces/FaultState, LATCHED_QOS
FAULT_EVENTS: Final = 'fault_events'  # ft_manip_interfaces/JointFault, EVENT_QOS
COMMANDS_HEARD: Final = 'fault_monitor/commands_heard'  # CommandHeard, TRAJECTORY_QOS
RECOVERY_PLAN: Final = 'recovery_plan'  # ft_manip_interfaces/RecoveryPlan, LATCHED_QOS
TASK_PLAN: Final = 'replanner/task_plan'  # RecoveryPlan of the healthy arm, LATCHED_QOS
FTWS_MAP: Final = 'workspace/map'  # sensor_msgs/PointCloud2, LATCHED_QOS
FTWS_MAP_MARKERS: Final = 'workspace/map_markers'  # MarkerArray, LATCHED_QOS
DESIGN_CANDIDATES: Final = 'design/candidates'  # DesignCandidate, HISTORY_QOS
DESIGN_BEST: Final = 'design/best'  # DesignCandidate, LATCHED_QOS
DESIGN_FINAL: Final = 'design/final'  # DesignCandidate, LATCHED_QOS
ROBOT_DESCRIPTION: Final = 'robot_description'  # std_msgs/String (URDF), LATCHED_QOS
DIAGNOSTICS: Final = '/diagnostics'  # diagnostic_msgs/DiagnosticArray, COMMAND_QOS

QUERY_FTWS: Final = 'workspace/query_ftws'  # srv QueryFtws
FREEZE_JOINT: Final = 'fault_monitor/freeze_joint'  # srv FreezeJoint
CLEAR_FAULT: Final = 'fault_monitor/clear_fault'  # srv ClearFault
INJECT_FAULT: Final = 'arm_sim/inject_fault'  # srv InjectFault
DESIGN_ARM: Final = 'designer/design_arm'  # action DesignArm


def markers(node_name: str) -> str:
    """Topic of a node's visualization_msgs/MarkerArray (LATCHED_QOS)."""
    return f'{node_name}/markers'


def service_events(service: str) -> str:
    """Topic on which the middleware publishes the requests and responses of a service."""
    return f'{service}/_service_event'
