"""What the re-planner can be told, and its settings as the planner reads them."""

from __future__ import annotations

from rclpy.parameter import Parameter

from ft_manip_ros.core.errors import InputError
from ft_manip_ros.core.planning.collision_setup import CollisionOptions
from ft_manip_ros.core.planning.decision import ExecutiveSettings
from ft_manip_ros.core.planning.settings import Order, PlanSettings, Policy, Relaxation
from ft_manip_ros.nodes.managed_node import ManagedNode
from ft_manip_ros.nodes.parameters import ARM_PARAMETERS, ParameterSpec

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
        'collision', False, 'Plan only motions on which no bodies touch; takes tens of ms longer.'
    ),
    ParameterSpec('padding', 0.01, 'Distance that bodies have to keep.', 'm', 0.0, 1.0),
    ParameterSpec(
        'link_radius',
        0.0,
        'Radius of capsules along the links, for an arm without collision bodies of its own.',
        'm',
        0.0,
        1.0,
    ),
    ParameterSpec('obstacles', '', 'Path of an obstacle file (YAML); empty: nothing around.'),
    ParameterSpec('srdf', '', 'Path of an SRDF whose disabled pairs are not checked.'),
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
    ParameterSpec(
        'detour_checks',
        1000,
        'Moves checked for collision to find ways round, at most; each takes about 0.01 ms, '
        'more where coal has to be asked.',
        '',
        0,
        1_000_000,
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
        'freshness',
        0.1,
        'A measured state that has waited this long is passed over where newer ones are coming.',
        's',
        0.001,
        60.0,
    ),
    ParameterSpec(
        'patience',
        0.4,
        'How long after the last arrival missed goals are tried again.',
        's',
        0.1,
        60.0,
    ),
    ParameterSpec('retries', 5, 'How often missed goals are tried again.', '', 0, 100),
)


def planning_settings(node: ManagedNode) -> PlanSettings:
    """Return how to plan, from a node with `PARAMETERS`."""
    return PlanSettings(
        policy=Policy(node.param('policy')),
        order=Order(node.param('order')),
        accepted=frozenset(_relaxation(name) for name in node.param('accepted_relaxations')),
        postures=node.param('postures'),
        attempts=node.param('attempts'),
        proof_boxes=node.param('proof_boxes'),
        detour_checks=node.param('detour_checks'),
        dwell=node.param('dwell'),
        rate_scale=node.param('rate_scale'),
        jerk_time=node.param('jerk_time'),
        sample_period=node.param('sample_period'),
        limit_weight=node.param('limit_weight'),
        seed=node.param('seed'),
    )


def watching_settings(node: ManagedNode) -> ExecutiveSettings:
    """Return how to watch the arm."""
    return ExecutiveSettings(
        state_timeout=node.param('state_timeout'),
        freshness=node.param('freshness'),
        patience=node.param('patience'),
        retries=node.param('retries'),
    )


def collision_options(node: ManagedNode) -> CollisionOptions | None:
    """Return what must not touch; None where nothing is to be checked."""
    if not node.param('collision'):
        return None
    return CollisionOptions(
        node.param('padding'),
        node.param('link_radius'),
        node.param('obstacles'),
        node.param('srdf'),
    )


def _relaxation(name: str) -> Relaxation:
    try:
        return Relaxation(name)
    except ValueError:
        raise InputError(
            'parameter accepted_relaxations',
            f'has {name!r}; known are {", ".join(repr(r.value) for r in Relaxation)}',
        ) from None
