"""Node parameters as data: default, meaning, unit, range, and whether they may change."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from ft_manip_ros.core.errors import InputError


@dataclass(frozen=True)
class ParameterSpec:
    """One parameter of a node.

    Attributes
    ----------
    name
        Its name.
    default
        Default value; it fixes the type. For a list that is empty by default give the type
        instead, e.g. ``Parameter.Type.STRING_ARRAY``.
    description
        What it means, as one sentence.
    unit
        Unit of the value, e.g. ``'s'``; empty where it has none.
    lower, upper
        Smallest and largest number accepted (both or neither).
    choices
        The strings that are accepted; empty for any.
    read_only
        True: fixed when the process starts. False: read when the node configures.
    """

    name: str
    default: Any
    description: str
    unit: str = ''
    lower: float | None = None
    upper: float | None = None
    choices: tuple[str, ...] = ()
    read_only: bool = False

    def descriptor(self) -> ParameterDescriptor:
        """Return the description that ``ros2 param describe`` shows."""
        constraints = [f'unit: {self.unit}'] if self.unit else []
        if self.choices:
            constraints.append(f'one of: {", ".join(self.choices)}')
        message = ParameterDescriptor(
            name=self.name,
            description=self.description,
            additional_constraints='; '.join(constraints),
            read_only=self.read_only,
        )
        if self.lower is not None and self.upper is not None:
            if isinstance(self.default, int) and not isinstance(self.default, bool):
                message.integer_range = [
                    IntegerRange(from_value=int(self.lower), to_value=int(self.upper), step=1)
                ]
            else:
                message.floating_point_range = [
                    FloatingPointRange(from_value=float(self.lower), to_value=float(self.upper))
                ]
        return message


ARM_PARAMETERS: Final = (
    ParameterSpec(
        'arm',
        'paredis_table_3',
        'The arm: name of an arm file in config/arms, path of an arm file, path or package:// URL '
        "of a URDF, or 'topic' for the URDF on robot_description.",
    ),
    ParameterSpec('base', '', 'Base link of the arm; only read for a URDF.'),
    ParameterSpec('tip', '', 'Tool link of the arm; only read for a URDF.'),
)

AUTOSTART: Final = ParameterSpec(
    'autostart',
    True,
    'Configure and activate at once; false leaves that to ros2 lifecycle or a launch file.',
    read_only=True,
)


def declare(node: Node, spec: ParameterSpec) -> None:
    """Declare a parameter; rclpy checks type and range from then on."""
    node.declare_parameter(spec.name, spec.default, spec.descriptor())


def read(node: Node, spec: ParameterSpec) -> Any:
    """Return the present value of a declared parameter.

    Raises
    ------
    InputError
        For NaN or infinity, in lists too, where no range excludes them, and for a string that is
        none of the choices.
    """
    parameter = node.get_parameter_or(spec.name, None)
    if parameter is None or parameter.type_ == Parameter.Type.NOT_SET:
        return []
    value = parameter.value
    numbers = value if isinstance(value, (list, tuple)) or hasattr(value, 'tolist') else [value]
    if any(isinstance(x, float) and not math.isfinite(x) for x in numbers):
        raise InputError(f'parameter {spec.name}', f'is {value}; it must be finite')
    if spec.choices and value not in spec.choices:
        raise InputError(
            f'parameter {spec.name}', f'is {value!r}; it must be one of {", ".join(spec.choices)}'
        )
    return value
