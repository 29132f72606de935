"""Declaring parameters with description, unit and range."""

import math
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import ParameterException
from rclpy.node import Node

from cspr_msgs_py.errors import StartError


def declare(
    node: Node,
    name: str,
    default: Any,
    description: str,
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    unit: str = "",
    read_only: bool = False,
) -> Any:
    """Declare a parameter and return its value.

    Parameters
    ----------
    node, name, default
        The default also sets the type: bool, int, float, str or a list of one of these.
    description, unit : str
        Shown by ``ros2 param describe``.
    minimum, maximum : float, optional
        Inclusive range of an int or a float; checked whenever the parameter is set.
    read_only : bool
        Whether it keeps its first value while the node runs.

    Raises
    ------
    StartError
        If the value given on the command line or in a parameter file has another type, lies outside the range
        or is not finite.
    """
    descriptor = ParameterDescriptor(
        description=f"{description} [{unit}]" if unit else description, read_only=read_only
    )
    if minimum is not None or maximum is not None:
        if isinstance(default, float):
            low = -math.inf if minimum is None else float(minimum)
            high = math.inf if maximum is None else float(maximum)
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        else:
            least = -(2**63) if minimum is None else int(minimum)
            most = 2**63 - 1 if maximum is None else int(maximum)
            descriptor.integer_range = [IntegerRange(from_value=least, to_value=most, step=1)]
    try:
        value = node.declare_parameter(name, default, descriptor).value
    except ParameterException as error:
        integer_for_double = isinstance(default, float) and "'INTEGER'" in str(error)
        hint = "; a double is written with a decimal point: 5.0" if integer_for_double else ""
        raise StartError(f"parameter {name}: {error}{hint}") from error
    numbers = [value] if isinstance(value, bool | int | float | str) else value
    if any(isinstance(number, float) and not math.isfinite(number) for number in numbers):
        raise StartError(f"parameter {name}: {value} is not a finite number")
    return value
