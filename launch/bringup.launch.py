"""Bring up the whole graph: every node configured, then activated, through its life cycle.

ros2 launch ft_manip_ros bringup.launch.py arm:=paredis_table_3 sim:=true
"""

from __future__ import annotations

from launch import LaunchContext, LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    LogInfo,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.event_handlers import OnProcessStart
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from launch_ros.substitutions import FindPackageShare
from lifecycle_msgs.msg import Transition

PACKAGE = 'ft_manip_ros'
ALWAYS = ('fault_monitor', 'replanner', 'workspace')
# Node, and the argument that switches it on.
OPTIONAL = {'arm_sim': 'sim', 'recorder': 'record', 'designer': 'design'}

ARGUMENTS = {
    'arm': ('', 'name of an arm file, or path of an arm file or URDF; as configured if empty'),
    'base': ('', 'base link, for a URDF'),
    'tip': ('', 'tool link, for a URDF'),
    'namespace': ('', 'namespace of all nodes'),
    'sim': ('true', 'start the simulated arm (false: a real one publishes joint_states)'),
    'record': ('true', 'record a bag'),
    'design': ('false', 'start the designer'),
}


def wanted_nodes(context: LaunchContext) -> list[str]:
    """Return the executables to start, by the values of the arguments."""
    chosen = [
        node
        for node, argument in OPTIONAL.items()
        if LaunchConfiguration(argument).perform(context) == 'true'
    ]
    return [*ALWAYS, *chosen]


def bring_up(context: LaunchContext) -> list[object]:
    """Start each node and take it to active."""
    given = {
        name: value
        for name in ('arm', 'base', 'tip')
        if (value := LaunchConfiguration(name).perform(context))
    }
    actions: list[object] = []
    for executable in wanted_nodes(context):
        parameters = {'autostart': False}
        parameters |= given if executable not in ('recorder', 'designer') else {}
        node = LifecycleNode(
            package=PACKAGE,
            executable=executable,
            name=executable,
            namespace=LaunchConfiguration('namespace'),
            parameters=[
                PathJoinSubstitution([FindPackageShare(PACKAGE), 'config', f'{executable}.yaml']),
                parameters,
            ],
            output='screen',
        )
        actions += [*life_cycle(node, executable), node]
    return actions


def life_cycle(node: LifecycleNode, name: str) -> list[object]:
    """Configure a node when its process starts, and activate it when it is configured."""

    def change(transition: int) -> EmitEvent:
        return EmitEvent(
            event=ChangeState(
                lifecycle_node_matcher=matches_action(node), transition_id=transition
            )
        )

    return [
        RegisterEventHandler(
            OnProcessStart(target_action=node, on_start=[change(Transition.TRANSITION_CONFIGURE)])
        ),
        RegisterEventHandler(
            OnStateTransition(
                target_lifecycle_node=node,
                start_state='configuring',
                goal_state='inactive',
                entities=[change(Transition.TRANSITION_ACTIVATE)],
            )
        ),
        RegisterEventHandler(
            OnStateTransition(
                target_lifecycle_node=node,
                start_state='activating',
                goal_state='active',
                entities=[LogInfo(msg=f'{name} is active')],
            )
        ),
    ]


def generate_launch_description() -> LaunchDescription:
    """Return what `ros2 launch` runs."""
    arguments = [
        DeclareLaunchArgument(
            name,
            default_value=default,
            description=description,
            # Anything else would silently count as no.
            choices=['true', 'false'] if name in OPTIONAL.values() else None,
        )
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=bring_up)])
