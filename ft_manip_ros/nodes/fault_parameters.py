"""Parameters of the node `fault_monitor`."""

from __future__ import annotations

from dataclasses import fields

from rclpy.parameter import Parameter

from ft_manip_ros.core.detection.settings import MonitorSettings
from ft_manip_ros.nodes.parameters import ARM_PARAMETERS, ParameterSpec

# name: (unit, lower, upper, description); defaults are those of MonitorSettings.
_SETTINGS = {
    'sensitivity': ('', 0.05, 100.0, 'Scales every lock threshold: 2 needs twice the evidence.'),
    'confirm_s': ('s', 0.0001, 10.0, 'A joint must have shown no motion for this long.'),
    'confirm_samples': ('', 2, 10_000, 'And over so many samples.'),
    'lag_prior_s': ('s', 0.001, 10.0, 'Tracking lag granted to every joint at any time.'),
    'slack_revolute': (
        'rad',
        1e-5,
        1.0,
        'Commanded motion a healthy joint may swallow until its own tracking is learned.',
    ),
    'slack_prismatic': ('m', 1e-6, 1.0, 'The same for a prismatic joint.'),
    'slack_unproved_factor': (
        '',
        1.0,
        100.0,
        'Multiplies the slack of a joint never seen to follow.',
    ),
    'slack_least_revolute': ('rad', 1e-7, 1.0, 'The least slack, however well a joint tracks.'),
    'slack_least_prismatic': ('m', 1e-8, 1.0, 'The same for a prismatic joint.'),
    'still_revolute': ('rad', 1e-9, 0.1, 'Motion that still counts as none (brake flex).'),
    'still_prismatic': ('m', 1e-9, 0.1, 'The same for a prismatic joint.'),
    'still_fraction': ('', 1e-6, 0.5, 'Share of the commanded motion that counts as none.'),
    'noise_factor': ('', 1.0, 20.0, 'Noise deviations inside which a joint stands still.'),
    'effort_factor': ('', 1.0, 100.0, 'Effort beyond this multiple of healthy effort is high.'),
    'stale_s': ('s', 0.001, 60.0, 'No sample for this long makes a joint STALE.'),
    'stale_periods': ('', 1.0, 1000.0, 'And for so many of its sample periods.'),
    'dead_s': (
        's',
        0.001,
        60.0,
        'Bit-for-bit repetition that makes a channel dead if it never repeats.',
    ),
    'time_jump_s': (
        's',
        0.01,
        3600.0,
        'Stamps going back by more than this start a new time line.',
    ),
    'runaway_revolute': (
        'rad',
        0.001,
        10.0,
        'Distance from the command beyond which leaving it is a RUNAWAY.',
    ),
    'runaway_prismatic': ('m', 0.0001, 10.0, 'The same for a prismatic joint.'),
    'drift_revolute': ('rad', 1e-4, 10.0, 'Motion within drift_s at rest that is a RUNAWAY.'),
    'drift_prismatic': ('m', 1e-5, 10.0, 'The same for a prismatic joint.'),
    'drift_s': ('s', 0.01, 600.0, 'Window of the former; slower creep is no fault.'),
    'default_velocity_revolute': (
        'rad/s',
        0.01,
        1000.0,
        'Largest speed believed of a joint without a known limit.',
    ),
    'default_velocity_prismatic': ('m/s', 0.001, 100.0, 'The same for a prismatic joint.'),
    'prove_revolute': ('rad', 1e-4, 10.0, 'Motion that a cleared joint must follow.'),
    'prove_prismatic': ('m', 1e-5, 10.0, 'The same for a prismatic joint.'),
    'not_executing_joints': (
        '',
        0,
        100,
        'So many commanded joints of which none moves mean a stopped arm; 0: never.',
    ),
    'start_timeout_s': (
        's',
        0.0001,
        60.0,
        'An arm may take so long to take up a trajectory that commands one joint alone.',
    ),
}


def _setting(name: str) -> ParameterSpec:
    unit, lower, upper, description = _SETTINGS[name]
    default = MonitorSettings.__dataclass_fields__[name].default
    return ParameterSpec(name, default, description, unit, lower, upper)


PARAMETERS = (
    *ARM_PARAMETERS,
    ParameterSpec(
        'frame', 'base_link', 'Frame of markers and poses of the tool: the base of the arm.'
    ),
    ParameterSpec(
        'exempt',
        Parameter.Type.STRING_ARRAY,
        'Joints that are never LOCKED, for example a gripper that closes on objects.',
    ),
    ParameterSpec(
        'reference_topic',
        '',
        'A sensor_msgs/JointState topic with commanded positions; empty: none.',
    ),
    ParameterSpec(
        'controller_state_topic',
        'joint_trajectory_controller/controller_state',
        'State of the controller, read where control_msgs is installed; empty: none.',
    ),
    ParameterSpec(
        'tool_pose_topic',
        '',
        'A geometry_msgs/PoseStamped topic with the tool as a tracker or a camera sees it, in the '
        "frame of the arm's base: tells stuck encoders from locked joints; empty: none.",
    ),
    ParameterSpec(
        'state_file',
        '',
        'File in which faults survive a restart of the node; empty: none.',
    ),
    ParameterSpec('forget', False, 'Start without the faults of the state file.'),
    *(_setting(item.name) for item in fields(MonitorSettings)),
)
